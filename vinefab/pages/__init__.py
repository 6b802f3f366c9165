"""What rooms share to show things: figures, drawings of nouns, animations, the page.

`colours` has the colours, `figure` blank figures and their way into bytes; `drawing` plans of maps
and robots in files, `plan_svg` the same as plain SVG text for the studio, `plan_document` such
plans that stand alone, for notebooks; `charts` the charts of searches and scores, `live_curve` one
without plotting; `animation_svg` and `animation_gif` moving deployments; `html` the page:
`page`, `blocks_html`.
"""
