"""Which branches are cut: against designs whose answer is known, and against every smaller cut."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import shapely

from vinefab.fabrication.checking import check_design
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.passes import BESIDE_MM, piece_ends, reach_mm
from vinefab.fabrication.pieces.partition import _Cutter, in_pieces, partition_of
from vinefab.fabrication.rules.as_built import flat_place_mm
from vinefab.fabrication.rules.catalog import rules_on, run_checks
from vinefab.fabrication.rules.rule import Scope, Subject
from vinefab.model.design import Build, Design, Level, PieceSettings, Waiver
from vinefab.model.laser import read_profile
from vinefab.model.outline import Part
from vinefab.outline.body_outline import body_outline, flat_layout

PROFILE = read_profile("co2_60w__stretchlon_200")


def design(*levels, widths=(24.0, 15.6, 10.1, 6.6), trunk=120.0, most=6, **build):
    widths = widths[: 1 + len(levels)]
    fillets = tuple(max(2.0, width / 4) for width in widths[1:])
    pieces = PieceSettings(most=most)
    made = Build(widths_mm=widths, fillet_mm=fillets, tail_mm=200.0, pieces=pieces, **build)
    return Design(name="tree", trunk_length_mm=trunk, levels=levels, build=made)


def fan(branches, length_mm, angle_deg, growth=1.0):
    return Level(
        branches=branches, length_mm=length_mm, fan_rad=math.radians(angle_deg), growth=growth
    )


CROSSED = design(fan(2, 100.0, 60.0), fan(2, 150.0, 130.0))
"""The inner grandchildren of both sides cross once."""


def test_one_cut_parts_one_crossing():
    found = partition_of(CROSSED, PROFILE)
    assert [piece.label for piece in found.pieces] == ["A", "B"]
    assert found.proven_least
    (sleeve,) = found.sleeves
    # Either of the two that cross could be cut, or a parent: the narrowest has the least rim.
    assert sleeve.branch in (4, 5)
    assert (sleeve.inner, sleeve.label) == ("A", "B")
    assert sleeve.socket_mm - sleeve.plug_mm == pytest.approx(15.0)
    assert sleeve.width_mm == pytest.approx(10.1)
    assert found.pieces[0].stubs == (sleeve.branch,)
    assert set(found.pieces[1].branches) == {sleeve.branch}


def test_a_tree_that_is_far_beyond_its_pieces_is_given_up_with_a_lower_bound():
    fans = (2, 120.5, 129.5, 1.461), (2, 159.2, 89.2, 0.721), (4, 78.9, 112.7, 0.57)
    levels = [fan(*one) for one in (*fans, (2, 192.0, 115.8, 1.115))]
    large = design(*levels, widths=(40.0, 26.0, 16.9, 11.0, 7.1), trunk=168.3)
    partition = partition_of(large, PROFILE)
    assert partition.unfinished
    subject = replace(Subject.of(large), profile=PROFILE)
    (found,) = run_checks(in_pieces(subject, partition), only={"VF-J02"}).findings
    assert found.measured > found.limit == 6
    assert found.message.startswith(f"at least {found.measured:.0f} pieces")


def built(one=CROSSED, **build):
    return one.changed(build=one.build.changed(**build))


PLAIN = built(pieces=None)
CROSSES = {"VF-T02", "VF-T03", "VF-L02"}
CASES = {
    "crossed": (CROSSED, 2, set()),
    "flat": (design(fan(3, 120.0, 150.0)), 1, set()),
    "without the key": (PLAIN, 1, CROSSES),
    "too few allowed": (built(pieces=PieceSettings(most=1)), 2, {"VF-J02"}),
    "no room": (built(pieces=PieceSettings(lap_mm=145.0)), 1, CROSSES | {"VF-J01"}),
    "a long trunk is left to tiles": (design(trunk=1500.0), 1, set()),
    "a long trunk": (CROSSED.changed(trunk_length_mm=1500.0), 1, CROSSES | {"VF-J01"}),
}
"""Robots, the number of their pieces, and the rules that forbid them."""


@pytest.mark.parametrize("case", CASES)
def test_a_robot_goes_in_so_many_pieces_or_is_refused_by_name(case):
    one, pieces, rules = CASES[case]
    found, report = partition_of(one, PROFILE), check_design(one, PROFILE)
    assert len(found.pieces) == pieces
    assert {finding.rule for finding in report.blocking} == rules
    if case == "crossed":
        (note,) = (run.note for run in report.run if run.rule == "VF-J02")
        assert note == "2 pieces, no fewer possible"
    if case == "no room":
        (finding,) = (one for one in report.blocking if one.rule == "VF-J01")
        assert set(finding.branches) == {"0.0.1", "0.1.0"}
        assert finding.measured < finding.limit
    if case == "a long trunk":
        assert {one.why for one in found.unparted} == {"do not fit the bed in one piece"}


def test_a_waived_crossing_is_not_cut():
    blocking = check_design(PLAIN, PROFILE).blocking
    waivers = tuple(Waiver(fingerprint=one.fingerprint, reason="tried by hand") for one in blocking)
    assert len(partition_of(CROSSED.changed(waivers=waivers), PROFILE).pieces) == 1


def test_a_robot_longer_than_the_bed_is_cut_to_fit():
    long = design(fan(2, 500.0, 40.0), fan(2, 420.0, 40.0), trunk=400.0)
    found = partition_of(long, PROFILE)
    assert len(found.pieces) > 1
    assert not found.unparted
    blocking = {finding.rule for finding in check_design(long, PROFILE).blocking}
    assert not blocking & {"VF-S01", "VF-J01", "VF-J02"}


def _passes(one, cut):
    """Whether the pieces that some cuts leave pass the rules about room, as they will be cut."""
    cutter = _Cutter(one, one.build.pieces, PROFILE, None, separate=False)
    if not set(cut) <= set(cutter.sleeves):
        return False
    partition = cutter._cut(tuple(sorted(cut)), proven_least=True)
    if any([*cutter._found_on(partition, piece)] for piece in partition.pieces):
        return False
    subject = in_pieces(replace(Subject.of(one), profile=PROFILE), partition)
    return not run_checks(subject, only=rules_on(Scope.ROOM)).blocking


@pytest.mark.parametrize("seed", range(4))
def test_no_fewer_cuts_pass(seed):
    random = np.random.default_rng(seed)
    one = design(
        fan(2, float(random.uniform(60, 120)), float(random.uniform(40, 80))),
        fan(3, float(random.uniform(90, 150)), float(random.uniform(100, 160))),
        trunk=float(random.uniform(60, 150)),
    )
    found = partition_of(one, PROFILE)
    cuts = len(found.sleeves)
    assert not found.unparted
    assert _passes(one, tuple(sleeve.branch for sleeve in found.sleeves))
    rows = range(1, one.branch_count)
    fewer = [cut for size in range(cuts) for cut in combinations(rows, size)]
    assert not any(_passes(one, cut) for cut in fewer[:60])


def halves_mm(contour, layout, sleeve, at_mm):
    """How far a contour's sides are from a branch's axis at a place along it, both together."""
    heading = float(layout.heading_rad[sleeve.branch])
    along = np.array([math.cos(heading), math.sin(heading)])
    place = layout.start_mm[sleeve.branch] + at_mm * along
    across = 40.0 * np.array([-along[1], along[0]])
    ring = shapely.Polygon(contour.flattened_mm(1e-4)).buffer(0.0)
    cut = shapely.intersection(ring, shapely.LineString([place - across, place + across]))
    part = min(shapely.get_parts(cut).tolist(), key=shapely.Point(place).distance)
    return part.length


@pytest.mark.parametrize("taper", [(), (0.95, 0.9, 0.8)], ids=["even", "tapered"])
@pytest.mark.parametrize("separate", [False, True], ids=["one pass", "two passes"])
@pytest.mark.parametrize("mounting", ["tail_inverted", "turned"])
def test_a_plug_goes_into_its_socket_with_the_ease(mounting, separate, taper):
    """Measured across the outlines: film of the plug and lumen of the socket, all along the lap."""
    build = CROSSED.build.changed(mounting=mounting, taper=taper)
    one, layout = CROSSED.changed(build=build), flat_layout(CROSSED.changed(build=build))
    found = partition_of(one, PROFILE, separate=separate)
    (sleeve,) = found.sleeves
    assert sleeve.socket_on_stub == (mounting == "tail_inverted")
    assert (sleeve.plug_on, sleeve.socket_on) == (
        ("B", "A") if mounting == "tail_inverted" else ("A", "B")
    )
    film = reach_mm(PROFILE, separate=separate)
    kerf = PROFILE.settings("cut" if separate else "weldcut").kerf_mm.value
    pieces = {piece.label: piece_ends(found, piece) for piece in found.pieces}
    plug = body_outline(one, film - kerf / 2.0, ends=pieces[sleeve.plug_on]).contour
    socket = body_outline(one, ends=pieces[sleeve.socket_on]).contour
    places = np.linspace(sleeve.outer_from_mm + 1e-3, sleeve.stub_to_mm - 1e-3, 9)
    films, lumens = (
        np.array([halves_mm(contour, layout, sleeve, at) for at in places])
        for contour in (plug, socket)
    )
    assert (lumens - films > 1.0 - 1e-3).all()
    if mounting == "tail_inverted":
        # The plug's rim comes past the socket's, and not looser than it must.
        assert lumens.min() - films.max() == pytest.approx(1.0, abs=2e-3)
    elif not taper:
        assert lumens - films == pytest.approx(np.ones(9), abs=2e-3)
    blend = halves_mm(socket, layout, sleeve, sleeve.blend_end_mm)
    whole = halves_mm(body_outline(one).contour, layout, sleeve, sleeve.blend_end_mm)
    assert blend == pytest.approx(whole, abs=1e-3)


@pytest.mark.parametrize("angle_deg", [16.0, 20.0, 30.0, 60.0])
@pytest.mark.parametrize("separate", [False, True], ids=["one pass", "two passes"])
def test_cuts_of_sockets_that_share_a_joint_keep_apart(separate, angle_deg):
    one = design(fan(3, 300.0, 2.0 * angle_deg), widths=(40.0, 15.0))
    cutter = _Cutter(one, one.build.pieces, PROFILE, None, separate=separate)
    found = cutter._cut((1, 2, 3), proven_least=True)
    inner = found.pieces[0]
    offset = reach_mm(PROFILE, separate=separate)
    around = body_outline(one, offset, ends=piece_ends(found, inner)).contour
    assert shapely.LinearRing(around.flattened_mm(0.01)).is_simple
    sockets = [
        shapely.union_all(
            [
                shapely.LineString([segment.start_mm, segment.end_mm])
                for segment in around.segments
                if segment.branch == name and segment.part is Part.SOCKET
            ]
        )
        for name in ("0.0", "0.1", "0.2")
    ]
    apart = min(one.distance(two) for one, two in combinations(sockets, 2))
    assert apart > 2.0 * BESIDE_MM * math.cos(math.radians(angle_deg) / 2.0) - 0.5


def test_places_on_a_sheet_with_several_pieces_are_not_in_the_layout_of_the_whole_robot():
    partition = partition_of(CROSSED, PROFILE)
    job = laser_job(CROSSED, PROFILE, partition=partition)
    whole = in_pieces(replace(Subject.of(CROSSED), profile=PROFILE, job=job), partition)
    assert len(whole.pieces) == 2
    assert all(flat_place_mm(whole, path, (0.0, 0.0)) is None for path in job.paths)
