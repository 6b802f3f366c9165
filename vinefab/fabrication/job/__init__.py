"""From outlines to what the laser does on a sheet: paths, marks, nesting, tiles."""
