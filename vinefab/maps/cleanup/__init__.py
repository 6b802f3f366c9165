"""The geometry that turns drawings and cells into valid maps: join, nest, straighten, repair."""
