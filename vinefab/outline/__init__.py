"""From a design to its exact outline of lines and arcs.

Other rooms use `body_outline.body_outline` (the outline of a design at an offset, with the reasons
why it may not be exact) and `body_outline.flat_layout` (where every branch lies on the sheet). The
rules also use `body_outline.ProblemKind` and the geometry of `joint` and `ends`.
"""
