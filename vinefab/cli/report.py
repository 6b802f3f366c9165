"""``vinefab report``: predictions as one page."""

from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.options import DesignIn, Force, MapsIn, Quiet, RecipeIn, Voice
from vinefab.core.atomic import ensure_writable, write_text
from vinefab.files.design import read_design
from vinefab.files.map import read_map
from vinefab.files.profile import read_profile
from vinefab.files.shipped import DEFAULT_RECIPE
from vinefab.pipeline.check import verdict
from vinefab.pipeline.grow import growth_options
from vinefab.pipeline.report import predict
from vinefab.pipeline.score import score_lines


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("report")(report_command)


def report_command(
    *,
    design: DesignIn,
    maps: MapsIn,
    out: Annotated[Path, typer.Option("--out", help="The page to write (HTML).")],
    recipe: RecipeIn = DEFAULT_RECIPE,
    poses: Annotated[int, typer.Option(min=1, help="Poses drawn per map.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the poses.")] = 0,
    body: Annotated[str, typer.Option(help="centerline or inflated.")] = "inflated",
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Write predictions (simulated), rules and materials of a design as one HTML page.

    Example: vinefab report three_level_tree --maps grid.geojson --out report.html
    """
    voice = Voice(quiet=quiet, force=force)
    ensure_writable(out, force=force)
    worlds = [read_map(path) for path in maps]
    found = predict(
        read_design(design),
        read_profile(recipe),
        worlds,
        poses=poses,
        seed=seed,
        options=growth_options(body),
    )
    write_text(out, found.page(), force=force)
    for score in found.scores.values():
        voice.say(score_lines(score)[-1].replace("composite", f"{score.task} (simulated)"))
    voice.say(verdict(found.prepared.report))
    voice.say(f"wrote {out}")
