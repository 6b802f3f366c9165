"""`vinefab.observation` on photos that are not kind: nothing is claimed that was not seen.

`many_unkind.py` has forty of them, larger; these are small enough for every run of the suite.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

sys.path.insert(0, str(Path(__file__).parent))

from unkind_photo import Body, Unkind, grow_bent, photographed

from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose, Start
from vinefab.observation.beside_prediction import GOES_ON, NO_VERDICT, UNEXPLAINED
from vinefab.observation.centre_lines import _Tracing
from vinefab.observation.observe_photo import PhotoSetup, observe_photo
from vinefab.photos.photo import read_photo

POSE = Pose(x_mm=100.0, y_mm=12.0, heading_rad=np.pi / 2)
WORLD = Map(
    name="table",
    bounds=shapely.box(0, 0, 220, 190),
    obstacles=(
        shapely.box(60, 120, 90, 140),
        shapely.Polygon([(128, 96), (170, 88), (162, 128)]),
        shapely.box(20, 40, 44, 70),
    ),
    starts=(Start(pose=POSE),),
)
DESIGN = Design(
    name="fork",
    trunk_length_mm=50.0,
    levels=(
        Level.of(branches=3, length_mm=65.0, angle_deg=110.0),
        Level.of(branches=2, length_mm=35.0, angle_deg=80.0),
    ),
    build=Build(widths_mm=(18.0, 14.0, 11.0), fillet_mm=(2.0, 2.0), tail_mm=20.0, pressure_kpa=0.0),
)
LOOK = Unkind(
    tilt_deg=14.0, turn_deg=200.0, distance_mm=620.0, pixels=(1000, 800), height_mm=15.0,
    opacity=0.55, wrinkle=0.05, light_deg=(60.0, 26.0), shade=0.2, wave_mm=1.0,
)  # fmt: skip
BODY = Body(half_angle_deg=12.0, bend_per_mm=1 / 450, joint_deg=6.0, absent=0.15)


def grown(design, seed, body=BODY):
    return grow_bent(design, WORLD, POSE, body, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def seen_of(tmp_path_factory):
    """Return the true branches of a photo, rendered once, and its observation by a design."""
    folder, taken = tmp_path_factory.mktemp("unkind"), {}

    def see(design, seed, look=LOOK, truth=None):
        path = folder / f"{seed}.jpg"
        if seed not in taken:
            taken[seed] = truth or grown(DESIGN, seed)
            path.write_bytes(photographed(WORLD, taken[seed], replace(look, seed=seed)))
        setup = PhotoSetup(obstacle_mm=look.height_mm)
        return taken[seed], observe_photo(read_photo(path), WORLD, design, POSE, setup)

    return see


@pytest.mark.parametrize(
    ("seed", "seam_mm"), [pytest.param(1, 0.4, marks=pytest.mark.thorough), (2, 2.0)]
)
def test_tips_are_right_or_in_doubt_and_no_stop_is_invented(seen_of, seed, seam_mm):
    truth, seen = seen_of(DESIGN, seed, replace(LOOK, seam_mm=seam_mm))
    assert seen.fits
    clear = [
        (t, b) for t, b in zip(truth, seen.compared.branches, strict=True) if not b.sight.doubts
    ]
    assert len(clear) >= len(truth) / 2
    for true, branch in clear:
        assert branch.deployed_observed == (len(true.points_mm) > 0)
        if branch.deployed_observed:
            assert np.hypot(*(branch.traced.points_mm[-1] - true.points_mm[-1])) < 8.0
        if branch.stop_observed in ("head_on", "corner"):
            assert true.stop in ("head_on", "corner")
    for branch in seen.compared.branches:
        if branch.sight.doubts:
            assert {contact.outcome for contact in branch.contacts} <= {"unclear"}
            assert branch.stop_observed not in ("head_on", "corner")


def test_film_that_goes_on_beyond_a_tip_leaves_it_in_doubt(seen_of):
    """One of three children is longer than planned."""
    build = DESIGN.build.changed(widths_mm=(18.0, 14.0), fillet_mm=(2.0,))
    short, longer = (
        DESIGN.changed(levels=(Level.of(3, length_mm, 110.0),), build=build)
        for length_mm in (40.0, 65.0)
    )
    truth, other = (grown(one, 3, replace(BODY, absent=0.0)) for one in (short, longer))
    truth[1] = other[1]
    _, seen = seen_of(short, 3, truth=truth)
    assert seen.fits
    doubts = [branch.sight.doubts for branch in seen.compared.branches]
    assert doubts == [(), (GOES_ON, UNEXPLAINED), (), ()]


def test_a_photo_without_a_verdict_gives_no_contact(seen_of):
    other = DESIGN.changed(levels=(Level.of(3, 20.0, 40.0), Level.of(2, 15.0, 40.0)))
    _, seen = seen_of(other, 1)
    assert not seen.fits
    assert seen.verdict.startswith("no verdict")
    for branch in seen.compared.branches:
        assert NO_VERDICT in branch.sight.doubts
        assert {contact.outcome for contact in branch.contacts} <= {"unclear"}


def test_a_short_hook_at_the_end_of_a_line_turns_no_child():
    """The fit may bend the last millimetres of a line; children are planned from the tube's end."""
    tracing = object.__new__(_Tracing)
    tracing.tree = Design.read("three_level_tree").tree
    tracing.radius_mm, tracing.early = [7.0] * len(tracing.tree), [False] * len(tracing.tree)
    child = int(np.flatnonzero(tracing.tree.parent == 0)[0])
    planned_deg = 90.0 + np.degrees(tracing.tree.offset_rad[child])
    for end in ([(50.0, 97.0), (52.1, 99.1)], [(50.0, 100.0)]):
        tracing.chains = [np.array([(50.0, 0.0), *end])]
        base, heading_rad = tracing.launch(child)
        assert base.tolist() == list(end[-1])
        assert np.degrees(heading_rad) == pytest.approx(planned_deg, abs=10.0)
