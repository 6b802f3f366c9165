import math
from dataclasses import replace

import numpy as np
import pytest

from tests.fabrication.rules.conftest import measured
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.pressure_rules import worst_growths
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.finding import Severity
from vinefab.model.map import Pose
from vinefab.physics.growth_pressure import FITTED, NO_TENSION

LOOSE = FITTED.changed(storage_kpa=NO_TENSION)


def findings(subject):
    return [finding for finding in run_checks(subject).findings if finding.rule == "VF-P03"]


def straight_and_bent(subject, turn_rad):
    """A fork whose second child meets a wall half way and turns there."""
    half = 100.0
    tip = np.array([300.0, 0.0])
    left, right = math.radians(30.0), math.radians(-30.0)
    corner = tip + half * np.array([math.cos(left), math.sin(left)])
    end = corner + half * np.array([math.cos(left + turn_rad), math.sin(left + turn_rad)])
    straight = tip + 2 * half * np.array([math.cos(right), math.sin(right)])
    return Deployment(
        tree=subject.layout.tree,
        pose=Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.0),
        points_mm=np.array([[0.0, 0.0], tip, tip, straight, tip, corner, end]),
        first_point=np.array([0, 2, 4, 7]),
        stop=np.zeros(3, dtype=np.int64),
        grown_mm=np.array([300.0, 200.0, 200.0]),
        contact_turn_rad=np.array([0.0, 0.0, abs(turn_rad)]),
    )


def test_the_worst_leaf_by_hand(make, profile):
    subject = Subject.of(make((2, 200.0, 60.0), widths_mm=(40.0, 20.0)), profile)
    loose = worst_growths(subject, (LOOSE,), 25.0)[0]
    scale = 25.0 / (2 * 20.0 / math.pi)
    by_hand = scale * (1.92 + 0.771 * 0.3 * math.exp(0.234 * math.pi / 6) + 0.771 * 0.2)
    assert loose.pressure_kpa == pytest.approx(by_hand)
    assert loose.branch in (1, 2)


def test_a_trunk_full_of_film_can_be_worse_than_its_leaves(make, profile):
    full = make((20, 400.0, 320.0), widths_mm=(40.0, 39.0), trunk_mm=10.0)
    worst = worst_growths(Subject.of(full, profile), (LOOSE,), 25.0)[0]
    assert worst.branch == 0


def test_contacts_on_a_map_add_to_it_and_are_named(make, profile):
    design = make((2, 200.0, 60.0), widths_mm=(100.0, 12.5))
    free = Subject.of(design, profile)
    assert findings(free) == []
    bent = replace(free, deployments=(straight_and_bent(free, 2.0),), map_names=("cave_3",))
    (found,) = findings(bent)
    assert (found.severity, found.branches) == (Severity.WARNING, ("0.1",))
    assert "on cave_3" in found.message
    assert found.marker_wkt.startswith("MULTILINESTRING")
    straight = worst_growths(free, (LOOSE,), 25.0)[0].pressure_kpa
    # The same tip, with a turn of 2 rad in front of its last 100 mm
    scale = 25.0 / (2 * 12.5 / math.pi)
    before = 0.771 * 0.3 * math.exp(0.234 * math.pi / 6) + 0.771 * 0.1
    by_hand = scale * (1.92 + before * math.exp(0.234 * 2.0) + 0.771 * 0.1)
    assert found.measured == pytest.approx(by_hand)
    assert by_hand > straight


def test_the_worst_of_several_maps_counts_and_of_robots_that_never_start_free_space(make, profile):
    free = Subject.of(make((2, 200.0, 60.0)), profile)
    never = replace(
        straight_and_bent(free, 0.0),
        points_mm=np.zeros((0, 2)),
        first_point=np.zeros(4, dtype=np.int64),
        stop=np.full(3, Stop.NOT_DEPLOYED, dtype=np.int64),
    )
    turns = (0.1, 1.5, 0.3)
    many = replace(free, deployments=(never, *(straight_and_bent(free, t) for t in turns)))
    worst = worst_growths(many, (LOOSE,), 25.0)[0]
    assert worst.place == "on deployment 3"
    alone = worst_growths(replace(free, deployments=(never,)), (LOOSE,), 25.0)[0]
    assert alone.place == "in free space"


def test_without_a_map_the_rule_says_what_it_did_not_see(make, profile):
    report = run_checks(Subject.of(make(), profile))
    (note,) = [run.note for run in report.run if run.rule == "VF-P03"]
    assert "no map" in note


def test_a_fit_of_the_recipes_own_tube_takes_the_place_of_the_published_one(make, profile):
    design = make((2, 200.0, 60.0), widths_mm=(40.0, 20.0))
    assert findings(Subject.of(design, profile)) == []
    # 30 mm to 20 mm is a factor of 1.5
    by_hand = 1.5 * (2.0 + (10.0 + 0.3) * math.exp(0.25 * math.pi / 6) + 0.2)
    names = ("yield_kpa", "drag_kpa_m", "storage_kpa", "friction", "width_mm")
    for storage_kpa, severities in ((1.0, []), (10.0, [Severity.WARNING, Severity.ERROR])):
        values = map(measured, (2.0, 1.0, storage_kpa, 0.25, 30.0))
        fit = dict(zip(names, values, strict=True))
        own = replace(profile, recipe=profile.recipe.changed(growth=fit))
        found = findings(Subject.of(design, own))
        assert [finding.severity for finding in found] == severities
    assert found[0].measured == pytest.approx(by_hand)
