"""Executors and evaluators: threads of this process, or the workers of a dask cluster."""
