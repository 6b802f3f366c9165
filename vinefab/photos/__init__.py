"""Photos from above: read, rectified to a plan in map millimetres, markers found.

``maps`` imports maps from what this room gives, ``observation`` compares robots with it. OpenCV
(extra ``vision``) is loaded only where it is needed.
"""
