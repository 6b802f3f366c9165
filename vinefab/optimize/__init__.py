"""The search for a design: space, optimizers, the loop and the record of a run."""
