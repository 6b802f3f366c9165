"""The search for a design: space, evaluation, optimizers, loop, record and result.

What other rooms may use:

- `settings` (`RunSettings` and its parts, `read_run`): what a run does
- `run` (`run_search`, `Search`): run it, with a record or without; its maps and its penalty
- `record.generations` (`RunIdentity`), `record.result`: results and records
- `space` (`Space`, `COSTS`), `manufacturability.ManufacturabilityPenalty`: designs as points, what
  they cost, and their penalty
- `run_pages`: live page, fronts, listings and sections for pages
- `optimizers.optimizer`: the protocol and the registry of optimizers
"""
