"""What a design is expected to do: deployments, measures, sensitivity, pressure, anchoring.

Other rooms may use `deploy` (one deployment: `deploy`, `growth_options`, `deploy_from_starts`),
`family_deployments` (`MapFamily`, `unseen_maps`, `PredictionPlan`, `deploy_family`,
`score_design_on_task`), `measures` (the measures and their `MeasureSpread`), `predict`
(`predict` and its page), `comparison` (`compare_designs`), `map_info`,
`aiming` (`aim_robots`) and `fix_proposal` (`propose_fix`).
"""
