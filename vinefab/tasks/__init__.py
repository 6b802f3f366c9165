"""Tasks: what a deployment scores, one file per task, and scores over maps and poses.

Other rooms use ``evaluate`` (`PreparedMap`, `poses_on`, `score_design`, `score_designs`,
`scores_of`, `composite`), ``shipped_tasks`` (`TASKS`, `make_task`), ``task`` (`Task`,
`TaskOutcomes`, `outcomes`, `HeadOnPenalty`), ``map_context`` (`MapContext`), ``covered_cells``
(`cover_of`) and the tasks themselves (`Coverage`, `Reach`, `Anchoring`). Areas and kernels belong
to this room alone.
"""
