"""Search over designs: the space, the optimizers, the loop and its record."""
