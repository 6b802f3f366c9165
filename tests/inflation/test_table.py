"""The joints table that ships: its rows, its bounds, and fans of many joints at once."""

import numpy as np
import pytest

from tests.inflation.make_table import left_out
from vinefab.inflation import table
from vinefab.inflation.compensation import FlatJoint, flat_joint
from vinefab.inflation.joint import JointShape, inflated_joint
from vinefab.inflation.table import (
    CHILDREN,
    FILLET,
    PATH,
    RATIO,
    STRAIN,
    FanTable,
    JointRows,
    Process,
    Scales,
    TableFile,
    fan_table,
    flat_fan,
    simulation_fingerprint,
    table_file,
)


@pytest.fixture(scope="module")
def file():
    return TableFile.read()


def test_it_is_of_this_simulation(file):
    made = "python tests/inflation/make_table.py rows.jsonl --fit --compare 500 makes a new one"
    assert file.fingerprint == simulation_fingerprint(), made


def test_it_is_small():
    assert PATH.stat().st_size < 300_000


@pytest.mark.parametrize("constant", ["mesh.GRADE", "joint_module.ACROSS", "membrane.POISSON"])
def test_another_simulation_has_another_fingerprint(monkeypatch, constant):
    before = simulation_fingerprint()
    monkeypatch.setattr(f"vinefab.inflation.table.{constant}", 10)
    assert simulation_fingerprint() != before


def test_the_table_of_another_simulation_is_not_used(monkeypatch):
    monkeypatch.setattr(table, "MODEL", -1)
    for function in (table_file, fan_table):
        function.cache_clear()
    try:
        assert fan_table(2) is None
    finally:
        monkeypatch.undo()
        for function in (table_file, fan_table):
            function.cache_clear()


@pytest.mark.parametrize(("children", "place"), [(1, 3), (2, 7), (3, 21)])
def test_its_rows_can_be_made_again(file, children, place):
    rows = JointRows.of(children, file.rows[children])
    ratio, fillet, strain = rows.places[place]
    left = rows.cut_deg[place]
    middle = [0.0] * (children % 2)
    flat = JointShape(
        angles_deg=(*-left, *middle, *left[::-1]),
        widths=(ratio,) * children,
        fillets=(fillet,) * (children + 1),
        hoop_strain=strain,
    )
    found = FlatJoint.of(inflated_joint(flat))
    half = children // 2
    # Angles are single numbers in the file: triangles may come out otherwise in narrow places.
    np.testing.assert_allclose(
        found.deployed_deg[children - half :][::-1], rows.deployed_deg[place], atol=0.7
    )
    backs = found.pull_backs[half:][::-1]
    np.testing.assert_allclose(backs, rows.figures[place, : children - half], atol=0.02)
    assert np.log(found.crotch_load) == pytest.approx(rows.figures[place, -2], abs=0.2)
    assert found.passage == pytest.approx(rows.figures[place, -1], abs=0.08)


@pytest.mark.parametrize("children", [2, 3, 4])
def test_rows_agree_with_the_others(file, children):
    """Each row is foretold by all the others, nearly as well as meshes agree."""
    known = FanTable(
        JointRows.of(children, file.rows[children]), file.scales[children].astype(float)
    )
    off = np.abs(left_out(known.compensation)).max(axis=1)
    assert np.median(off) < 0.5
    assert np.quantile(off, 0.9) < 1.2


def test_it_tells_its_bounds(file):
    assert file.compensation.joints >= 50
    assert file.deployment.joints >= 50
    assert 0.1 < file.compensation.typical_deg < file.compensation.largest_deg < 4.0
    assert file.deployment.typical_deg < file.deployment.largest_deg < 6.0


@pytest.mark.parametrize(
    ("fan_deg", "place"),
    [
        (80.0, (0.2, 0.15, 0.05)),
        (80.0, (0.6, 0.6, 0.05)),
        (80.0, (0.6, 0.15, 0.4)),
        (2.0, (0.6, 0.15, 0.05)),
        (28.0, (0.4, 0.1, 0.01)),
        (300.0, (0.6, 0.15, 0.05)),
    ],
)
def test_it_does_not_answer_beyond_its_rows(fan_deg, place):
    assert fan_table(2).compensated(fan_deg, place) is None
    assert fan_table(2).deployed(fan_deg, place) is None
    assert fan_table(4).compensated(44.0, place) is None


@pytest.mark.parametrize("children", CHILDREN)
def test_flat_and_deployed_fans_fit(children):
    known, place = fan_table(children), (0.6, 0.15, 0.05)
    fan_deg = 110.0 if children > 1 else 0.0
    flat = known.compensated(fan_deg, place)
    again = known.deployed(flat.flat_deg[-1] - flat.flat_deg[0], place)
    assert again.deployed_deg[-1] == pytest.approx(fan_deg / 2.0, abs=1.5)
    for angles in (flat.flat_deg, again.deployed_deg, flat.side_offsets):
        np.testing.assert_allclose(angles, -np.array(angles)[::-1], atol=1e-9)


def test_many_joints_at_once_are_the_single_ones():
    random = np.random.default_rng(4)
    count = random.integers(2, 5, 40)
    fan = np.radians(random.uniform(50.0, 150.0, 40))
    place = [random.uniform(*ends, 40) for ends in (RATIO, FILLET, STRAIN)]
    many = flat_fan(count, fan, *place)
    assert many.is_within.all()
    compared = 0
    for k in range(40):
        ratio, fillet, strain = (one[k] for one in place)
        single = fan_table(int(count[k])).compensated(
            float(np.degrees(fan[k])), (ratio, fillet, strain)
        )
        if single is not None:
            angles = np.degrees(many.angles_rad[k, : count[k]])
            np.testing.assert_allclose(angles, single.flat_deg, atol=1e-3)
            backs = many.pull_backs[k, : count[k]]
            np.testing.assert_allclose(backs, single.pull_backs, atol=1e-5)
            assert np.degrees(many.fan_rad[k]) == pytest.approx(angles[-1] - angles[0])
            compared += 1
        assert np.isnan(many.angles_rad[k, count[k] :]).all()
    assert compared > 20


def test_many_joints_beyond_the_ranges_get_the_nearest_place():
    many = flat_fan(np.array([2, 2, 7, 1]), np.radians([80.0, 80.0, 80.0, 0.0]), 0.6, 0.9, 0.05)
    edge = flat_fan(2, np.radians(80.0), 0.6, FILLET[1], 0.05)
    assert not many.is_within[:3].any()
    assert many.fan_rad[0] == pytest.approx(edge.fan_rad[0])
    assert many.fan_rad[2] == pytest.approx(np.radians(80.0))
    assert many.fan_rad[3] == 0.0
    assert edge.is_within.all()


def test_a_process_runs_through_smooth_rows():
    random = np.random.default_rng(1)
    x = random.random((200, 4))

    def smooth(places):
        a, b, c, d = places.T
        return np.column_stack([np.sin(2.0 * a) + b * c, np.cos(a + d)])

    scales = Scales(lengths=np.full(4, 1.5), noise=1e-3)
    process = Process(x, smooth(x), scales)
    inside = 0.2 + 0.6 * random.random((50, 4))
    np.testing.assert_allclose(process(inside), smooth(inside), atol=0.01)
    assert np.sqrt(np.mean(left_out(process) ** 2)) < 0.02
    far = process.deviation(np.full((1, 4), 5.0))
    assert (far > 5.0 * process.deviation(inside).max()).all()


def test_flat_joint_of_one_straight_child_is_straight():
    found = flat_joint(JointShape.fan(1, 0.0, width=0.6, fillet=0.15, hoop_strain=0.05))
    assert (found.source, found.flat.angles_deg) == ("table", (0.0,))
    assert found.pull_backs[0] > 0.0
