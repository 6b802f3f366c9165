"""Draw the pictures of the documentation anew: rules that fire, shipped designs, environments.

Run it as ``python docs/draw_pictures.py`` in a checkout; it needs the tests' cases of rules. What
it draws is simulated or computed, and the same on every machine.
"""

import sys
from importlib import import_module
from pathlib import Path

import shapely
from shapely.geometry.base import BaseGeometry

import vinefab as vf
from vinefab.fabrication.rules.run_rules import run_checks
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.finding import Finding
from vinefab.model.outline import Contour
from vinefab.pages.plan_document import plan_document
from vinefab.pages.plan_svg import outline_svg

PICTURES = Path(__file__).resolve().parent / "pictures"
CASES = Path(__file__).resolve().parent.parent / "tests" / "fabrication" / "rules"
RED = "#c0392b"
AROUND_MM = 90.0
"""What is shown around a finding."""

HOMES = {"cave_explorer": "cave", "cave_explorer_pieces": "cave", "six_branch_anchor": "cave"}
"""Environments of shipped designs; of all others the Grid."""


def main() -> None:
    for name, text in {**rule_pictures(), **gallery_pictures()}.items():
        path = PICTURES / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(f"{path.relative_to(PICTURES)}: {len(text) / 1000:.0f} kB")


def rule_pictures() -> dict[str, str]:
    """Return a picture for every rule whose test case has a place on the flat robot."""
    sys.path.insert(0, str(CASES))
    cases, makers = import_module("test_rules"), import_module("conftest")
    profile = read_profile(DEFAULT_RECIPE)
    found = {}
    for rule, case in cases.CASES.items():
        subject = case.fires(makers.make_design, profile)
        fired = [one for one in run_checks(subject).findings if one.rule == rule]
        if fired and subject.outline is not None and _marked(fired[0]) is not None:
            found[f"rules/{rule}.svg"] = rule_picture(subject.outline.contour, fired[0])
    return found


def rule_picture(contour: Contour, finding: Finding) -> str:
    """Return the outline around a finding, with what it marks in red."""
    marked = _marked(finding)
    whole = shapely.box(*contour.box_mm)
    seen = shapely.box(*marked.buffer(AROUND_MM).bounds).intersection(whole)
    box = (seen if seen.area > 0.0 else whole).bounds
    lines = [
        part for part in shapely.get_parts(marked) if part.geom_type in ("LineString", "Polygon")
    ]
    drawn = "".join(_path(line) for line in lines)
    spots = [part for part in shapely.get_parts(marked) if part.geom_type == "Point"]
    wide = max(box[2] - box[0], box[3] - box[1])
    if finding.x_mm is not None and finding.y_mm is not None:
        spots.append(shapely.Point(finding.x_mm, finding.y_mm))
    drawn += "".join(
        f'<circle cx="{spot.x:.2f}" cy="{-spot.y:.2f}" r="{wide / 60:.2f}" '
        f'style="fill:none;stroke:{RED};stroke-width:{wide / 200:.2f}"/>'
        for spot in spots
    )
    numbers = ""
    if finding.measured is not None and finding.limit is not None:
        numbers = f" is {finding.measured:.4g}, limit {finding.limit:.4g} {finding.unit}"
    return plan_document(
        [outline_svg(contour, filled=contour.closed), f'<g style="stroke:{RED}">{drawn}</g>'],
        box,
        title=f"{finding.rule}:{numbers or ' fires'}",
    )


def gallery_pictures() -> dict[str, str]:
    """Return every shipped design on a map and flat, and a map of every environment."""
    found = {}
    for name in vf.designs():
        design = vf.Design.read(name)
        world = vf.maps.generate(HOMES.get(name, "grid"), seed=3)
        found[f"gallery/{name}.svg"] = str(design.grow(world)._repr_svg_())
        found[f"gallery/{name}_flat.svg"] = str(design._repr_svg_())
    for name in ("grid", "cave", "rubble", "corridors", "pegs"):
        found[f"gallery/{name}.svg"] = str(vf.maps.generate(name, seed=3)._repr_svg_())
    return found


def _marked(finding: Finding) -> BaseGeometry | None:
    if finding.marker_wkt:
        return shapely.from_wkt(finding.marker_wkt)
    if finding.x_mm is None or finding.y_mm is None:
        return None
    return shapely.Point(finding.x_mm, finding.y_mm)


def _path(line: BaseGeometry) -> str:
    ring = line.exterior if line.geom_type == "Polygon" else line
    words = "L".join(f"{x:.2f} {-y:.2f}" for x, y in ring.coords)
    return (
        f'<path d="M{words}" style="fill:none;stroke:{RED};stroke-width:3px;'
        'vector-effect:non-scaling-stroke;stroke-dasharray:none"/>'
    )


if __name__ == "__main__":
    main()
