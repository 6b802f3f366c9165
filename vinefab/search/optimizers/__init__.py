"""Optimizers, all driven by ask and tell.

`optimizer` has the protocol (`Optimizer`, `OptimizerConfig`), the coordinates (`SearchAxes`) and
the registry `OPTIMIZERS`.
"""
