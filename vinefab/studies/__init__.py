"""The paper's experiments, the optimizer contest and the benchmark; only the commands load them.

`reproduction` registers and does the experiments (`do_experiments`), `optimizer_contest` compares
optimizers on run files, `benchmark` measures speed (`run_benchmark`), `cluster_scaling` simulates
searches on many workers.
"""
