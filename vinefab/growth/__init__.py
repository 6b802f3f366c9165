"""Growth: how a design deploys on a map.

Other rooms use ``batch`` (`grow_on`: one design, one pose; `Batch`, `GrowthBlock`, `Launches`,
`TerrainSet`: many growths at once), ``terrain`` (`Terrain`), ``options`` (`GrowthOptions`) and
``plan`` (`Plan`, `Plans`). A few growths are over before code is compiled; Python runs the kernel
then (`vinefab.growth.batch.chosen_engine`).
"""
