"""Growth: how a design deploys on a map.

Other rooms use ``simulator`` (`grow_on`: one design, one pose), ``terrain`` (`Terrain`),
``options`` (`GrowthOptions`), ``plan`` (`Plan`, `Plans`) and ``batch`` (`Batch`, `GrowthBlock`,
`Launches`, `TerrainSet`: many growths at once). A few growths are
over before code is compiled; Python runs the kernel then (``engine``).
"""
