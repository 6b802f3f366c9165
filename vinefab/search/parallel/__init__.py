"""Evaluating many points at once: work units on threads, or on the workers of a dask cluster.

`executor` runs work units; `point_evaluator` has the protocol `PointEvaluator` and
`ThreadEvaluator`; `dask_cluster` has `DaskEvaluator`; `work_placement` decides what goes to a
cluster.
"""
