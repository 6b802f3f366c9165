"""The nouns that rooms share: frozen, validated dataclasses; their file forms are in ``files``.

`Design`, `BranchTree`, `Map`, `Pose`, `Deployment`, `Score`, `Contour`, `Job`, `LaserProfile` and
`CheckReport`, one module each.
"""
