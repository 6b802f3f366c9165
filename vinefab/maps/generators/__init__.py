"""One file per environment: a seed and options in, a map out; ``environments`` lists them."""
