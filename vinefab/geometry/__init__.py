"""From a design to exact outlines, offsets and placement on the bed."""
