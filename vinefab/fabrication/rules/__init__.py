"""Design rules: a design with its outline and laser job in, findings out.

Other rooms, and packages with rules of their own, use `rule` (`Rule`, `Limits`, `RuleApplied`,
`RuleNotApplicable`, `Violation`), `subject.Subject` (what rules check), `catalog.RULES` (all rules
by id) with `catalog.changed_limits`, and `run_rules.run_checks` (the report of all rules, as JSON
by `run_rules.checks_text`). How far designs are from passing, and the smallest change that makes
one pass, is the search's: `vinefab.search.penalty_batch` and `vinefab.search.fix`.

A new rule is a `Rule` in one of the modules, and its cases in the tests.
"""
