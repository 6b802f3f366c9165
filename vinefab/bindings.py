"""Functions of rooms above that methods of nouns call: the one list of ways upward.

Bound when the package is imported; each room is loaded when one of its functions is first called.
"""

from typing import TYPE_CHECKING

from vinefab.core.front_door import ABOVE, imported_later

if TYPE_CHECKING:
    from vinefab import noun_pictures
    from vinefab.app import maps, verbs
    from vinefab.maps import summary
    from vinefab.pages import html
    from vinefab.prediction import deploy, map_info
    from vinefab.search import run_pages
else:
    noun_pictures = imported_later("vinefab.noun_pictures")
    maps = imported_later("vinefab.app.maps")
    verbs = imported_later("vinefab.app.verbs")
    summary = imported_later("vinefab.maps.summary")
    html = imported_later("vinefab.pages.html")
    deploy = imported_later("vinefab.prediction.deploy")
    map_info = imported_later("vinefab.prediction.map_info")
    run_pages = imported_later("vinefab.search.run_pages")

ABOVE.picture = lambda noun: noun_pictures.svg_of(noun)
ABOVE.plot = lambda drawn, ax, *, legend: noun_pictures.plotted(drawn, ax, legend=legend)
ABOVE.score_page = lambda score: noun_pictures.score_page(score)
ABOVE.history_page = lambda history: run_pages.history_figure(history)
ABOVE.grow = lambda design, world, pose, **options: deploy.grow_design(
    design, world, pose, **options
)
ABOVE.deployment_summary = lambda deployment: deploy.deployment_summary(deployment)
ABOVE.write_deployment = lambda deployment, path, *, force: deploy.write_deployment(
    deployment, path, force=force
)
ABOVE.map_info = lambda world, *, width_mm, passages: map_info.map_info(
    world, width_mm=width_mm, passages=passages
)
ABOVE.map_summary = lambda world: summary.map_summary(world)
ABOVE.page = lambda title, blocks: html.page(title, blocks)
ABOVE.blocks_html = lambda blocks: html.blocks_html(blocks)
ABOVE.verb = lambda name: verbs.VERBS[name].function
ABOVE.map_function = lambda name: getattr(maps, name)
ABOVE.map_generator = lambda environment: maps.generator(environment)
