"""Ten cases of "touch these three points": ``python tests/search/target_cases.py [GENERATIONS]``.

An arena of 600 x 400 mm with five boxes and three points, drawn anew for each case; the shipped
film, and film of 0.1 mm on a 300 mm roll on a bed of 500 x 300 mm; one flat outline, and up to six
pieces. Each search gets a minute on two cores: 120 s of processor time, measured as such. A case is
solved where the winner touches three of three and passes every rule that forbids.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import shapely
from shapely import Polygon, affinity

from vinefab.core.errors import VinefabError
from vinefab.model.map import Map, Pose, Start
from vinefab.search.manufacturability import with_build_for_film
from vinefab.search.run import run_search, violations_of
from vinefab.search.settings import RunSettings

PROCESSOR_S = 120.0

SEALED = "co2_60w__stretchlon_800"
"""Film that no laser welds is sealed with an impulse sealer."""

SPACE = {
    "levels": [2, 4],
    "length_mm": [40.0, 300.0],
    "angle_deg": [30.0, 160.0],
    "branches": [2, 3],
    "growth_percent": [50.0, 160.0],
}


def arena(seed):
    """Return five boxes in an arena, and three points that a body has room at."""
    rng = np.random.default_rng(seed)
    bounds, start = shapely.box(0.0, 0.0, 600.0, 400.0), (25.0, 200.0)
    boxes: list[Polygon] = []
    while len(boxes) < 5:
        width, height = rng.uniform(40.0, 110.0, 2)
        x, y = rng.uniform(70.0, 580.0 - width), rng.uniform(20.0, 380.0 - height)
        box = affinity.rotate(shapely.box(x, y, x + width, y + height), rng.uniform(0.0, 90.0))
        apart = all(box.distance(other) > 30.0 for other in boxes)
        if apart and bounds.contains(box) and box.distance(shapely.Point(start)) > 45.0:
            boxes.append(box)
    free = shapely.buffer(bounds.difference(shapely.union_all(boxes)), -15.0)
    points: list[shapely.Point] = []
    while len(points) < 3:
        point = shapely.Point(*rng.uniform((120.0, 20.0), (580.0, 380.0)).round())
        if free.contains(point) and all(point.distance(other) > 80.0 for other in points):
            points.append(point)
    return Map(
        name=f"arena_{seed}",
        bounds=bounds,
        obstacles=tuple(boxes),
        starts=(Start(pose=Pose(x_mm=start[0], y_mm=start[1], heading_rad=0.0)),),
    ).with_targets(*((point.x, point.y) for point in points))


def thick_film(folder):
    """Write the recipe of film of 0.1 mm on a 300 mm roll, on a bed of 500 x 300 mm."""
    shipped = Path(__file__).parents[2] / "laser_profiles"
    changed = {
        "materials/stretchlon_800": [("value = 0.05,", "value = 0.1,"), ("= 1524.0", "= 300.0")],
        "machines/co2_60w": [
            ("value = 1000.0", "value = 500.0"),
            ("value = 600.0", "value = 300.0"),
        ],
        f"recipes/{SEALED}": [],
    }
    for name, replacements in changed.items():
        text = (shipped / f"{name}.toml").read_text(encoding="utf-8")
        for old, new in replacements:
            assert text.count(old) == 1, (name, old)
            text = text.replace(old, new)
        path = folder / f"{name}.toml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder / f"recipes/{SEALED}.toml"


def cases(folder, generations, thick_trunk_mm=None, space=SPACE):
    """Yield each search by its film and pieces, and its number."""
    # Too much thick film is folded in bodies of 24 mm (VF-W03): it has the width by default.
    films = {
        "shipped film": ("", {"trunk_width_mm": 24.0}),
        "0.1 mm, 300 mm roll": (
            str(thick_film(folder)),
            {"trunk_width_mm": thick_trunk_mm} if thick_trunk_mm else {},
        ),
    }
    for film, (recipe, trunk) in films.items():
        for pieces in (None, {"most": 6}):
            for number in range(1, 11):
                path = arena(number).write(folder / f"arena_{number}.geojson", force=True)
                build = {**trunk, "width_ratio": 0.65}
                settings = RunSettings(
                    name=f"case_{number}",
                    maps={"files": [path]},
                    task="reach",
                    space=space,
                    build=build if pieces is None else {**build, "pieces": pieces},
                    search={"population": 60, "generations": generations},
                    evaluation={"recipe": recipe},
                )
                kind = f"{film}, {'flat' if pieces is None else 'pieces'}"
                yield kind, number, with_build_for_film(settings)


def solved(settings, folder):
    """Return whether a search found what was asked for, and a line about it."""
    try:
        result = run_search(settings, folder)
    except VinefabError as error:
        return False, f"refused: {error}", None
    assert result.targets is not None
    broken = violations_of(result, settings)
    why = [note for note in result.notes if note.startswith("robots that may break the rules")]
    words = "; ".join(filter(None, (result.targets.headline, broken, *why)))
    return result.targets.all_touched and not broken, words, result


def main():
    """Search every case and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("generations", nargs="?", type=int, default=40)
    parser.add_argument("--only", default="", help="kinds of cases with these words")
    parser.add_argument("--thick-trunk-mm", type=float, help="default: as the film asks for")
    parser.add_argument("--tree", choices=["levels", "free"], default="levels")
    parser.add_argument("--bends", type=int, default=0, help="most of each free branch")
    given = parser.parse_args()
    bends = {"bends": [0, given.bends]} if given.bends else {}
    space = SPACE | {"tree": given.tree} | bends
    found: dict[str, list[bool]] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for kind, number, settings in cases(folder, given.generations, given.thick_trunk_mm, space):
            if given.only not in kind:
                continue
            began = time.process_time()
            is_solved, words, _ = solved(settings, folder / f"{kind}_{number}")
            spent_s = time.process_time() - began
            found.setdefault(kind, []).append(is_solved and spent_s <= PROCESSOR_S)
            sign = "solved" if found[kind][-1] else "not   "
            sys.stdout.write(f"{kind:>26} {number:2} {sign} {spent_s:5.1f} s  {words}\n")
            sys.stdout.flush()
    for kind, each in found.items():
        sys.stdout.write(f"{kind}: {sum(each)} of {len(each)} solved\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
