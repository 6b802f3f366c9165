"""The paper's experiments, the optimizer contest and the benchmarks; nothing else loads them."""
