"""What rooms share to show things: figures, drawings of nouns, animations, the page.

`figure` has blank figures, colours and their way into bytes; `drawing` plans of maps and robots;
`charts` the charts of searches and scores; `animation_svg` and `animation_gif` moving deployments;
`html` the page: `Report`, `Section`, `Table`, `Picture`, `page_html`.
"""
