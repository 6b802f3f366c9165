"""Design rules: a design with its outline and laser job in, findings out.

Other rooms, and packages with rules of their own, use `rule` (`Rule`, `Limits`, `RuleApplied`,
`RuleNotApplicable`, `Violation`, and `Subject`: a design with all that rules check) and `catalog`:
`RULES` by id, `changed_limits`, and `run_checks` (the report of all rules, as JSON by
`checks_text`). A new rule is a `Rule` in one of the modules, and its cases in the tests.
"""
