"""The geometry that turns drawings and cells into valid maps, for the importers.

``assemble.assemble`` makes a map of drawn shapes: `joining` chains loose lines, `nesting` tells
solids, holes and bounds apart, `drawn_shapes` repairs rings. ``raster.raster_map`` makes a map of
cells, with walls fitted by `cell_walls`.
"""
