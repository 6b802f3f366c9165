"""Optimizers against each other."""
