"""Growth: how a design deploys on a map.

Other rooms use ``simulator`` (`grow_on`: one design, one pose), ``terrain`` (`Terrain`),
``options`` (`GrowthOptions`), ``plan`` (`Plan`, `Plans`) and ``batch`` (`Batch`, `Block`,
`Launches`, `TerrainSet`: many growths at once). Tests hold the compiled ``kernel`` against a
readable twin; a few growths are over before code is compiled, so Python runs the kernel then.
"""
