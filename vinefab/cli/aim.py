"""``vinefab aim``: where to put a robot's base."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import (
    BodyIn,
    CommandOutput,
    ContactsIn,
    DesignIn,
    Force,
    GrowthIn,
    HalfAngleIn,
    JsonOut,
    Quiet,
    contacts_arguments,
    ensure_kind,
    growth_choice,
    growth_from,
    parameters_from,
)
from vinefab.core.atomic import write_bytes
from vinefab.growth.options import growth_arguments
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.map_geojson import read_map
from vinefab.prediction.aiming import (
    AimPlan,
    aim_growth,
    aim_robots,
    held_against,
)
from vinefab.prediction.family_deployments import MapFamily
from vinefab.prediction.pose_search import PLACING_DEG, PLACING_MM
from vinefab.prediction.provenance import origin_of
from vinefab.tasks.shipped_tasks import make_task


def aim_command(
    *,
    design: DesignIn,
    map_file: Annotated[Path, typer.Option("--map", help="The map file.")],
    task: Annotated[str, typer.Option(help="coverage, reach or anchoring.")] = "reach",
    parameter: Annotated[
        list[str] | None, typer.Option("--set", help="A task's parameter: radius_mm=60.")
    ] = None,
    where: Annotated[
        str,
        typer.Option(
            help="Where the base may stand: border (of the free space, growing in, and the map's "
            "starts), anywhere, starts, or a start in words: 'left side', 'area 0,0 50,480'."
        ),
    ] = "border",
    robots: Annotated[
        int, typer.Option(help="Also choose so many poses that together cover most.")
    ] = 1,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="DESIGN",
            help="What to hold it against; default: a plain vine of the same total length.",
        ),
    ] = None,
    alone: Annotated[bool, typer.Option("--alone", help="Hold it against nothing.")] = False,
    placing_mm: Annotated[
        float, typer.Option(help="A base is placed within so many mm (assumed).")
    ] = PLACING_MM,
    placing_deg: Annotated[
        float, typer.Option(help="A base is turned within so many degrees (assumed).")
    ] = PLACING_DEG,
    deployments: Annotated[
        int, typer.Option(help="About so many deployments for the search of each design.")
    ] = 100_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the fresh deployments.")] = 0,
    workers: Annotated[
        int | None,
        typer.Option(min=1, max=64, help="Threads; no result depends on it. Default: processors."),
    ] = None,
    growth: GrowthIn = None,
    body: BodyIn = None,
    head_on_half_angle_deg: HalfAngleIn = None,
    contacts: ContactsIn = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="A page (HTML), or its picture (SVG, PNG).")
    ] = None,
    json_out: JsonOut = None,
    quiet: Quiet = False,
    force: Force = False,
) -> None:
    """Search a map for the pose from which a robot scores best (simulated).

    Example: vinefab aim grid_explorer --map grid.geojson --task reach --out aim.html
    """
    output = CommandOutput(quiet=quiet, json_out=json_out, force=force)
    ensure_kind("--out", out, (".html", ".svg", ".png"), force=force)
    output.ensure_json()
    given = growth_from(
        growth, body=body, head_on_half_angle_deg=head_on_half_angle_deg, contacts=contacts
    )
    names = [design] if against is None else [design, against]
    read = [read_design(name) for name in names]
    growth_choice(names, read, given)
    designs = held_against(*read, alone=alone)
    choice = aim_growth(designs, given)
    plan = AimPlan(
        where=where,
        deployments=deployments,
        placing_mm=placing_mm,
        placing_deg=placing_deg,
        robots=robots,
        seed=seed,
        options=choice.options,
    )
    scored_on = make_task(task, parameters_from(parameter or []))
    world = read_map(map_file)
    with output.progress("aim") as show:
        found = aim_robots(designs, world, scored_on, plan, show, workers)
    arguments = ["vinefab", "aim", design, "--map", str(map_file), "--task", task]
    arguments += [word for text in parameter or [] for word in ("--set", text)]
    arguments += ["--where", where, "--robots", str(robots), "--seed", str(seed)]
    arguments += ["--placing-mm", f"{placing_mm:g}", "--placing-deg", f"{placing_deg:g}"]
    arguments += ["--deployments", str(deployments)]
    arguments += ["--against", against] if against is not None else ["--alone"] if alone else []
    arguments += [*contacts_arguments(contacts), *growth_arguments(choice.options)]
    origin = origin_of(
        shlex.join(arguments), designs, None, [MapFamily(label=world.name, worlds=(world,))]
    )
    found = replace(found, origin=origin, growth_notes=choice.notes)
    output.give_json(found.json_text())
    if out is not None:
        page = out.suffix.lower() == ".html"
        data = found.page().encode() if page else found.picture(out.suffix)
        write_bytes(out, data, force=force)
        output.say(f"wrote {out}")
    for line in found.summary:
        output.say(line)
