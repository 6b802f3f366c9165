"""The drawing layer, plans, animations and the page, shared by all rooms above.

`panel` is the drawing layer: panels of primitives in millimetres, with the colours and the places
of labels, put together to pages. `page_files` and `page_pdf` write pages. `plan` draws maps, starts
and robots into panels. `plan_svg` gives maps and robots as SVG text that a page can move, for the
studio. `animation` shows moving deployments; `html` is the page.
"""
