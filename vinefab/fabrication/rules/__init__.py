"""Design rules: a design with its outline and laser job in, findings out; penalty and fix.

Other rooms, and packages with rules of their own, use `rule` (`Rule`, `Limits`, `RuleApplied`,
`RuleNotApplicable`, `Violation`), `subject.Subject` (what rules check), `catalog.RULES` (all rules
by id) with `catalog.changed_limits`, `run_rules.run_checks` (the report of all rules, as JSON by
`run_rules.checks_text`), `penalty.fabrication_penalty` (how far a design is from manufacturable)
and `fix.fix_design` (the smallest change that clears the errors).

A new rule is a `Rule` in one of the modules, and its cases in the tests.
"""
