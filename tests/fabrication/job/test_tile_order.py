"""Film in tiles, simulated run by run: what moves is one piece, and the robot hangs on it."""

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon

from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.job.tile_order import BRIDGE_MM, in_making_order
from vinefab.fabrication.job.tile_window import FilmTile
from vinefab.fabrication.job.tiling import STRIP_TARGET
from vinefab.model.design import Design
from vinefab.model.files.shipped import names
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, read_profile
from vinefab.model.outline import Contour, Part, Segment

MACHINES = {
    "laser, one pass": ("co2_40w__stretchlon_200", "weldcut"),
    "laser, seam and cut": ("co2_40w__stretchlon_200", "weld+cut"),
    "hot tip and knife": ("hot_tip_220_knife__stretchlon_200", "auto"),
    "hot tip and scissors": ("hot_tip_250__stretchlon_200", "auto"),
}


@cache
def tiled_jobs() -> dict[tuple[str, str], tuple[Job, LaserProfile]]:
    """Return all shipped designs that lie in tiles, on machines of every kind."""
    found = {}
    for kind, (recipe, process) in MACHINES.items():
        profile = read_profile(recipe)
        for name in (name for name in names("design") if "pieces" not in name):
            job = laser_job(Design.read(name), profile, SheetOptions(process=process))
            # Those that overlap lie flat in pieces only: rules forbid them in one.
            if job.tiles and Polygon(seam_of(job)).is_valid:
                found[name, kind] = job, profile
    return found


def on_film(tile: Job, points):
    window = tile.facts["window_x_mm"], tile.facts["window_y_mm"]
    return np.add(points, window)


def cuts_of(tile: Job, profile: LaserProfile) -> list[LineString]:
    return [
        LineString(on_film(tile, path.contour.flattened_mm()))
        for path in tile.paths
        if path.operation in (Operation.CUT, Operation.WELDCUT)
        and not path.settings_in(profile).tool.by_hand
    ]


def pieces_after(job: Job, cuts: list[LineString]) -> int:
    """Return the number of pieces that film falls into, necks of less than 1 mm taken as cut."""
    film = shapely.box(0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)
    left = film - shapely.union_all(cuts).buffer(0.5, cap_style="flat") if cuts else film
    return sum(part.area > 10.0 for part in shapely.get_parts(left))


def seam_of(job: Job):
    (path,) = job.along(Operation.WELDCUT) or job.along(Operation.WELD)
    return path.contour.flattened_mm()


def test_designs_of_every_kind_lie_in_tiles() -> None:
    kinds = [kind for _, kind in tiled_jobs()]
    assert {kind: kinds.count(kind) >= 4 for kind in MACHINES} == dict.fromkeys(MACHINES, True)
    assert max(len(job.tiles) for job, _ in tiled_jobs().values()) > 10


@pytest.mark.parametrize("kind", MACHINES)
def test_the_film_that_moves_is_one_piece_and_the_mouth_is_cut_last(kind: str) -> None:
    for job, profile in (one for (_, k), one in tiled_jobs().items() if k == kind):
        cuts = list[LineString]()
        for tile in job.tiles:
            # Before this run the film moved into its window.
            assert pieces_after(job, cuts) == 1
            cuts += cuts_of(tile, profile)
        if kind == "hot tip and scissors":
            assert cuts == []
            continue
        one_pass = bool(job.along(Operation.WELDCUT))
        mouth = cuts[-1]
        assert len(mouth.coords) == 2
        seam = seam_of(job)
        assert mouth.buffer(0.1).contains(LineString([seam[0], seam[-1]]))
        assert pieces_after(job, cuts[:-1]) == 1
        # At last the robot is free: of bridges when they are cut as well.
        whole = [LineString(path.contour.flattened_mm()) for path in job.along(Operation.CUT)]
        assert pieces_after(job, [*cuts, *([] if one_pass else whole)]) == 2
        assert pieces_after(job, cuts) == (2 if one_pass else 1)
        if not one_pass:
            _check_bridges(whole[0], cuts)


def _check_bridges(around: LineString, cuts: list[LineString]) -> None:
    """Bridges are gaps of one length, none farther from the next than the film may flap."""
    uncut = around - shapely.union_all(cuts).buffer(0.05, cap_style="flat")
    merged = shapely.line_merge(uncut)
    gaps = [gap for gap in shapely.get_parts(merged) if gap.length > 0.5]
    assert len(gaps) >= 2
    assert [gap.length for gap in gaps] == pytest.approx([BRIDGE_MM] * len(gaps), abs=0.3)


@pytest.mark.parametrize("kind", MACHINES)
def test_crosses_on_the_robot_lie_in_its_lumen_and_in_both_windows(kind: str) -> None:
    for job, _ in (one for (_, k), one in tiled_jobs().items() if k == kind):
        lumen = Polygon(seam_of(job))
        made = {
            number: on_film(tile, np.array(tile.facts["robot_targets_made_mm"]).reshape(-1, 2))
            for number, tile in enumerate(job.tiles, start=1)
        }
        assert sum(map(len, made.values())) > 0
        for number, tile in enumerate(job.tiles, start=1):
            found = np.array(tile.facts["robot_targets_found_mm"]).reshape(-1, 2)
            for point in found:
                at = on_film(tile, point)
                earlier = np.concatenate([made[k] for k in range(1, number)])
                assert np.hypot(*(earlier - at).T).min() < 1e-6
                assert lumen.contains(Point(at))
                assert lumen.exterior.distance(Point(at)) >= 4.5
            lines = [p for p in tile.along(Operation.REG) if p.label == STRIP_TARGET]
            count = len(found) + len(made[number])
            assert len(lines) == 2 * count
            for line in lines:
                assert line.contour.length_mm == pytest.approx(5.0)
                x0, y0, x1, y1 = line.contour.box_mm
                assert min(x0, y0) >= 0.0
                assert max(x1 - tile.sheet_width_mm, y1 - tile.sheet_height_mm) <= 0.0


@pytest.mark.parametrize("kind", ["hot tip and knife", "hot tip and scissors"])
def test_every_place_of_the_seam_is_sealed_before_a_second_machine_cuts(kind: str) -> None:
    for job, profile in (one for (_, k), one in tiled_jobs().items() if k == kind):
        sealed, cutting = [], False
        for tile in job.tiles:
            cutting |= bool(cuts_of(tile, profile))
            welds = tile.along(Operation.WELD)
            assert not (cutting and welds)
            sealed += [LineString(on_film(tile, p.contour.flattened_mm())) for p in welds]
        (seam,) = job.along(Operation.WELD)
        missed = LineString(seam.contour.flattened_mm()) - shapely.union_all(sealed).buffer(1e-3)
        assert missed.length == pytest.approx(0.0, abs=1e-6)
        # Where two tiles meet, a seam runs over the other by 12 mm.
        over = sum(line.length for line in sealed) - seam.contour.length_mm
        assert over == pytest.approx(12.0 * (len(sealed) - 1), abs=0.5)


def test_an_overlap_of_the_recipe_that_is_larger_is_kept() -> None:
    profile = read_profile("hot_tip_220__stretchlon_200")
    tip = profile.recipe.hot_tip
    longer = tip.changed(overlap_mm=tip.overlap_mm.changed(value=20.0))
    changed = replace(profile, recipe=profile.recipe.changed(hot_tip=longer))
    job = laser_job(Design.read("plain_vine"), changed)
    runs = list(itertools.chain.from_iterable(tile.along(Operation.WELD) for tile in job.tiles))
    over = sum(path.contour.length_mm for path in runs) - job.length_mm(Operation.WELD)
    assert over == pytest.approx(20.0 * (len(runs) - 1))
    assert math.isclose(job.tiles[0].facts["overlap_mm"], 20.0)


def test_a_last_tile_whose_window_holds_the_mouth_cuts_it_at_its_end() -> None:
    profile = read_profile("co2_40w__stretchlon_200")

    def tile(low_x: float, *paths: LaserPath) -> FilmTile:
        return FilmTile(
            pieces=set(), box_mm=(0.0, 0.0, 1.0, 1.0), paths=list(paths), low_mm=(low_x, 0.0)
        )

    def line(operation: Operation, x0: float, x1: float, part: Part) -> LaserPath:
        segment = Segment(start_mm=(x0, 50.0), end_mm=(x1, 50.0), part=part, branch="0")
        contour = Contour.from_segments([segment], closed=False)
        return LaserPath(operation=operation, contour=contour)

    side = line(Operation.WELDCUT, 10.0, 150.0, Part.SIDE)
    mouth = line(Operation.CUT, 60.0, 100.0, Part.MOUTH)
    for low_x, runs in (
        (50.0, 2),
        (70.0, 3),
    ):  # the second window holds the mouth, or not all of it
        made = in_making_order([tile(0.0, side, mouth), tile(low_x, side)], profile, (200.0, 100.0))
        assert len(made) == runs
        assert [path.contour.parts for path in made[-1].paths][-1] == (Part.MOUTH,)
        assert all(path.operation is Operation.WELDCUT for run in made[:-1] for path in run.paths)
