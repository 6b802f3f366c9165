from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.core.view import document
from vinefab.model.design import Build, Design, Pouch
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.model.map import Map, Pose, Start
from vinefab.prediction.family_deployments import (
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
)
from vinefab.prediction.measures import ANCHORING, IDEAL_ANCHORING
from vinefab.prediction.predict import (
    AnchoringPrediction,
    HeldForces,
    OverMaps,
    anchoring_blocks,
    anchoring_headline,
    anchoring_on,
    predict_anchoring,
)
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.evaluate import score_design

TASK = anchoring_on(read_profile(DEFAULT_RECIPE).material)


def halls(*gaps_mm):
    """A plain vine deployed once in each of several halls of known width."""
    worlds = []
    for gap_mm in gaps_mm:
        walls = (
            shapely.box(0, 0, 200, 50 - gap_mm / 2),
            shapely.box(0, 50 + gap_mm / 2, 200, 100),
        )
        start = Start(pose=Pose(x_mm=10.0, y_mm=50.0, heading_rad=0.0))
        bounds = shapely.box(0, 0, 200, 100)
        worlds.append(Map(name=f"{gap_mm}", bounds=bounds, obstacles=walls, starts=(start,)))
    pouch = Pouch(shape="rectangle", length_mm=30.0, width_mm=50.0)
    build = Build.standard(1, trunk_width_mm=20.0).changed(pouch=pouch, pressure_kpa=10.0)
    design = Design(name="v", trunk_length_mm=60.0, build=build)
    plan = PredictionPlan(poses=1)
    family = MapFamily(label="halls", worlds=tuple(worlds))
    return design, deploy_family(design, PreparedFamily.of(family, plan), plan)


def held_n(gap_mm, friction, pressure_kpa=10.0):
    """F = 2 P A mu of the pouch of 30 x 50 mm."""
    return 2.0 * pressure_kpa * 1e-3 * 30.0 * (50.0 - np.pi * gap_mm / 2.0) * friction


def test_report_comparison_score_and_search_say_the_same(result, explorer):
    """One implementation: the same gaps, engaged leaves and limits, with pouches and without."""
    pouch = Pouch(shape="rectangle", length_mm=30.0, width_mm=60.0)
    jammed = explorer.changed(build=explorer.build.changed(pouch=pouch, pressure_kpa=60.0))
    assert Anchoring() == TASK
    for design in (explorer, jammed):
        deployed = deploy_family(design, result.prepared, PredictionPlan(poses=2, seed=3))
        score = score_design(
            design, result.prepared.maps, result.prepared.poses, Anchoring(),
            PredictionPlan().options,
        )  # fmt: skip
        scores = [evaluation.score for evaluation in score.evaluations]
        shown, other = ANCHORING, IDEAL_ANCHORING
        if design is explorer:
            shown, other = other, shown
        assert deployed.outcomes.values[shown.key].tolist() == scores
        assert deployed.outcomes.spread(other) is None
        assert (score.title_of_task == "anchoring, ideal case") == (design is explorer)
        found = predict_anchoring(design, deployed, TASK)
        means = np.reshape(scores, (-1, 2)).mean(axis=1)
        part = found.likely.ideal if design is explorer else found.likely.engaged
        assert part.median == pytest.approx(np.median(means))
        force_n = [evaluation.terms["force_n"] for evaluation in score.evaluations]
        means = np.reshape(force_n, (-1, 2)).mean(axis=1)
        assert found.likely.force_n.median == pytest.approx(np.median(means))
        assert (sum(force_n) > 0.0) == (design is jammed)
        capped = [evaluation.terms["capped"] > 0.0 for evaluation in score.evaluations]
        assert any(capped) == (design is jammed)


def test_a_pouch_holds_where_it_is_wider_than_its_gap():
    design, result = halls(25.0)
    (low, likely, high) = predict_anchoring(design, result, TASK).held
    for held, friction in ((low, 0.2), (likely, 0.3), (high, 0.8)):
        assert held.friction == friction
        assert held.force_n.median == pytest.approx(held_n(25.0, friction))
        assert held.engaged.median == held.ideal.median == 1.0
    narrow = design.build.changed(pouch=Pouch(shape="rectangle", length_mm=30.0, width_mm=39.0))
    loose = predict_anchoring(design.changed(build=narrow), result, TASK)
    assert (loose.engaged_percent, loose.nothing_percent) == (0.0, 100.0)
    assert loose.likely.force_n.high == loose.likely.engaged.high == 0.0
    # The formula does not notice.
    assert loose.likely.ideal.median == 1.0


def test_a_third_of_the_engaged_may_be_idle_and_the_ideal_case_counts_all(result, explorer):
    found = predict_anchoring(explorer, result, TASK)
    robots = [
        TASK.anchored(deployment, explorer.build, result.prepared_map(index).context)
        for index, deployment in enumerate(result.deployments)
    ]
    turns = [np.sort(robot.leaves.turn_rad) for robot in robots]
    every = [np.exp(0.3 * turn).sum() for turn in turns]
    some = [np.exp(0.8 * turn[: -(-2 * len(turn) // 3)]).sum() for turn in turns]
    assert [robot.amplification(0.8, 2.0 / 3.0)[0] for robot in robots] == pytest.approx(some)
    means = np.reshape(every, (-1, 2)).mean(axis=1)
    shown = found.likely.ideal
    assert shown.median == pytest.approx(np.median(means))
    assert [shown.low, shown.high] == pytest.approx(np.percentile(means, [5.0, 95.0]).tolist())
    # Without pouches none is engaged.
    assert (found.leaves, found.has_pouches, found.engaged_percent) == (18, False, 0.0)
    assert found.likely.force_n.high == found.held[2].engaged.high == 0.0
    assert "ideal case" in anchoring_headline(found).name


def test_forces_are_median_and_percentiles_over_maps():
    design, result = halls(20.0, 22.0, 24.0, 26.0, 28.0)
    found = predict_anchoring(design, result, TASK, mass_g=5.0)
    # The force falls linearly with the gap; of five values 5 % lie 0.2 steps from either end.
    for held in found.held:
        assert held.force_n.median == pytest.approx(held_n(24.0, held.friction))
        assert held.force_n.high == pytest.approx(held_n(20.4, held.friction))
        assert held.force_n.low == pytest.approx(held_n(27.6, held.friction))
    assert (found.engaged_percent, found.limited_percent) == (100.0, 0.0)
    assert (found.pressure_kpa, found.mass_g) == (10.0, 5.0)


def test_seams_limit_a_known_share_of_the_deployments():
    design, result = halls(20.0, 22.0, 24.0, 26.0, 45.0)
    # A seam of the test tube, 70 kPa at 20 mm, around the trunk: 2 w P_b w_b / pi.
    limit_n = 2.0 * 20.0 * 70e-3 * 20.0 / np.pi
    pressure_kpa = 10.0 * limit_n / held_n(23.0, 0.8)
    strong = design.changed(build=design.build.changed(pressure_kpa=pressure_kpa))
    found = predict_anchoring(strong, result, TASK)
    # Inflated, the pouch is 31.8 mm wide: four of five hold, of these two beyond the limit.
    assert (found.engaged_percent, found.limited_percent, found.nothing_percent) == (
        80.0,
        40.0,
        20.0,
    )
    assert found.held[2].force_n.high == pytest.approx(limit_n)
    assert found.held[2].force_n.median == pytest.approx(held_n(24.0, 0.8, pressure_kpa))


def known_prediction():
    def over(value):
        return OverMaps(median=value, low=value / 4.0, high=value * 1.5)

    held = tuple(
        HeldForces(
            friction=friction, engaged=over(10.0 * friction), some_idle=over(5.0 * friction),
            ideal=over(20.0 * friction), force_n=over(5.0 * friction),
        )
        for friction in (0.2, 0.3, 0.8)
    )  # fmt: skip
    return AnchoringPrediction(
        label="halls", leaves=6, has_pouches=True, held=held, engaged_percent=62.54,
        nothing_percent=6.04, limited_percent=12.51, pressure_kpa=10.0, mass_g=10.0,
    )  # fmt: skip


def test_page_and_json_show_known_forces():
    prediction = known_prediction()
    data, section = anchoring_blocks([prediction])
    amplification, forces = section.tables
    assert amplification.rows[0] == (
        "leaves that are engaged", "2.00 (0.50 to 3.00)", "3.00 (0.75 to 4.50)",
        "8.00 (2.00 to 12.00)",
    )  # fmt: skip
    assert [row[2] for row in amplification.rows[1:]] == [
        "1.50 (0.38 to 2.25)", "6.00 (1.50 to 9.00)",
    ]  # fmt: skip
    assert "6 leaves" in amplification.caption
    assert (
        "62.5 % of the leaves are engaged; 6.0 % of the deployments hold" in amplification.caption
    )
    assert "at 10 kPa" in forces.caption
    assert "in 12.5 % of the deployments" in forces.caption
    # 1 N over the weight of 10 g.
    shown = [tuple(map(str, row)) for row in forces.rows]
    assert shown[0] == ("0.2", "1.00", "0.25", "1.50", "10")
    assert shown[2] == ("0.8", "4.00", "1.00", "6.00", "41")
    (content,) = document([data])["anchoring"]
    assert content["engaged_percent"] == 62.5
    assert content["limited_percent"] == 12.5
    assert content["held"][2] == {
        "friction": 0.8,
        "engaged": {"median": 8.0, "low": 2.0, "high": 12.0},
        "some_idle": {"median": 4.0, "low": 1.0, "high": 6.0},
        "ideal": {"median": 16.0, "low": 4.0, "high": 24.0},
        "force_n": {"median": 4.0, "low": 1.0, "high": 6.0},
    }
    assert content["over_friction"] == {
        "engaged": [0.5, 12.0], "ideal": [1.0, 24.0], "force_n": [0.25, 6.0],
    }  # fmt: skip
    headline = anchoring_headline(prediction)
    assert (headline.value, headline.tone) == ("3.0 x", "plain")
    assert headline.detail.startswith(
        "1.50 N at 10 kPa: median over halls at friction 0.3; 90 % of the maps 0.5 to 12.0 x, "
        "0.25 to 6.00 N over friction 0.2 to 0.8 (assumed); 63 % of the leaves jam, 6 % of the "
        "deployments hold nothing"
    )
    assert headline.detail.endswith("every leaf that came out jams: 6.0 x")
    bare = replace(prediction, has_pouches=False)
    fact = anchoring_headline(bare)
    assert (fact.name, fact.value) == ("anchoring amplification, ideal case", "6.0 x")
    assert " N " not in fact.detail
    _, section = anchoring_blocks([bare])
    assert len(section.tables) == 1
    assert "only the ideal case" in section.paragraphs[1]
