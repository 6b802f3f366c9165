"""What rooms share to show things: the drawing layer, plans, charts, animations, the page.

`panel` is the drawing layer: panels of primitives in millimetres, with the colours and the places
of labels, put together to pages. `page_files` and `page_pdf` write pages. `plan` draws maps, starts
and robots into panels, `charts` how searches and scores went. `plan_svg` gives maps and robots as
SVG text that a page can move, for the studio. `animation` shows moving deployments; `html` is the
page.
"""
