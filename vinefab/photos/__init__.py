"""Photos from above: read, rectified to a plan in map millimetres, markers found.

What other rooms use:

- ``photo.read_photo``: a `Photo` from a PNG or JPEG file; ``photo.fit_camera``: the `PhotoCamera`
  by control points, with its errors; ``PhotoCamera.to_map`` and ``to_photo`` convert places, at any
  height; ``rectified``: a `PlanView` of an area, at any height.
- ``found_markers.marker_points``: the corners of a map's markers in a photo as `ControlPoints`;
  ``square_points``: those of markers that lie anywhere; ``measured_markers``: pixels, blur and
  noise of each.

``maps`` imports maps from the results of this room, ``observation`` compares robots with it. OpenCV
(extra ``vision``) is loaded only where it is needed.
"""
