"""Optimizers: one file each, all driven by ask and tell.

`optimizer` has the protocol (`Optimizer`, `OptimizerConfig`) and the coordinates (`SearchAxes`);
`shipped_optimizers` the registry `OPTIMIZERS` and `make_optimizer_config`.
"""
