"""What rooms share to show things: the drawing layer, plans, charts, animations, the page.

`panel` is the drawing layer: panels of primitives in millimetres, put together to pages;
`page_svg`, `page_png` and `page_pdf` write pages. `plan` draws maps, starts and robots into panels,
`charts` how searches and scores went; `label_places` says where labels lie, `colours` has the
colours. `plan_svg` gives maps and robots as SVG text that a page can move, for the studio.
`animation_svg` and `animation_gif` show moving deployments; `figure` has the matplotlib side of the
charts in studies; `html` is the page.
"""
