"""The geometry that turns drawings and cells into valid maps, for the importers.

`drawn_shapes` repairs rings and chains loose lines; ``assemble.assemble`` tells solids, holes and
bounds apart and makes a map of them. ``raster.raster_map`` makes a map of cells, with walls of
fitted lines.
"""
