"""The search for a design: space, evaluation, optimizers, loop, record and result.

What other rooms may use:

- `settings` (`RunSettings` and its parts, `read_run`): what a run does
- `run.run_search`, `loop.Search`: run it, with a record or without
- `run.generated_maps`, `run.training_maps`, `run.penalty_of`: its maps and its penalty
- `record.generations` (`RunIdentity`, `package_versions`), `record.result`: results and records
- `costs.COSTS`: costs of designs, to minimize or to limit
- `space`, `manufacturability.ManufacturabilityPenalty`: designs as points, and their penalty
- `front_files`, `run_pages`: fronts, listings and sections for pages; they load matplotlib
- `optimizers.shipped_optimizers`: the registry of optimizers
"""
