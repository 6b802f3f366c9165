import json

import numpy as np
import pytest

from vinefab.core.limits import rad
from vinefab.fabrication.rules.catalog import checks_text
from vinefab.model.deployment import Deployment, Stop, deployment_text
from vinefab.model.design import Build, Design, Level
from vinefab.model.finding import CheckReport, Finding, RuleRun, RuleSkipped, Severity
from vinefab.model.map import Pose
from vinefab.model.score import Evaluation, Score


@pytest.fixture
def deployment() -> Deployment:
    """A fork whose first child wraps round a corner and whose second never emerged."""
    fork = Level(branches=2, length_mm=50.0, fan_rad=rad(60.0), growth=0.5)
    design = Design(name="y", trunk_length_mm=100.0, levels=(fork,), build=Build.standard(2))
    return Deployment(
        tree=design.tree,
        pose=Pose(x_mm=1.0, y_mm=2.0, heading_rad=rad(30.0)),
        points_mm=np.array([[1.0, 2.0], [87.5, 52.0], [87.5, 52.0], [100.0, 60.0], [120.0, 60.0]]),
        first_point=np.array([0, 2, 5, 5]),
        stop=np.array([Stop.FULL_LENGTH, Stop.HEAD_ON, Stop.NOT_DEPLOYED]),
        grown_mm=np.array([100.0, 34.8, 0.0]),
        contact_turn_rad=np.array([0.0, rad(32.6), 0.0]),
    )


def test_a_deployment_has_the_agreed_form(deployment: Deployment) -> None:
    text = deployment_text(deployment, "y", "grid", {"length_mm": np.float64(134.8)})
    read = json.loads(text)
    assert read["schema"] == "vinefab/deployment-1"
    assert (read["design"], read["map"]) == ("y", "grid")
    assert read["pose"] == {"x_mm": 1.0, "y_mm": 2.0, "heading_deg": 30.0}
    assert read["metrics"] == {"length_mm": 134.8}
    trunk, first, second = read["branches"]
    assert (trunk["id"], trunk["parent"], trunk["level"]) == ("0", None, 1)
    assert first == {
        "id": "0.0",
        "parent": "0",
        "level": 2,
        "points_mm": [[87.5, 52.0], [100.0, 60.0], [120.0, 60.0]],
        "planned_mm": 50.0,
        "grown_mm": 34.8,
        "stop": "head_on",
        "contact_turn_deg": 32.6,
        "joint_deg": -30.0,
        "contacts_mm": [[100.0, 60.0]],
    }
    assert (second["stop"], second["points_mm"], second["joint_deg"]) == ("not_deployed", [], 30.0)
    assert (second["planned_mm"], second["grown_mm"]) == (25.0, 0.0)


def test_a_score_has_the_agreed_form() -> None:
    pose = Pose(x_mm=0.0, y_mm=-1.5, heading_rad=rad(-90.0))
    one = Evaluation(
        map_name="m",
        pose=pose,
        score=0.25,
        terms={"area": np.float64(0.5)},
        parts={"area seen": 0.25},
    )
    score = Score(
        task="coverage",
        evaluations=(one,),
        composite={"mean": 0.25, "best": 0.25},
        parts={"area seen": 0.25},
        growth={"body": "inflated"},
        notes=("one pose",),
    )
    read = json.loads(score.json_text())
    assert read.pop("generator").startswith("written by vinefab")
    agreed = {
        "schema": "vinefab/score-1",
        "task": "coverage",
        "growth": {"body": "inflated"},
        "evaluations": [
            {
                "map": "m",
                "pose": {"x_mm": 0.0, "y_mm": -1.5, "heading_deg": -90.0},
                "score": 0.25,
                "terms": {"area": 0.5},
                "parts": {"area seen": 0.25},
            }
        ],
        "composite": {"mean": 0.25, "best": 0.25},
        "parts": {"area seen": 0.25},
        "notes": ["one pose"],
    }
    assert {key: read[key] for key in agreed} == agreed  # a new fact is a new key


def test_checks_have_the_agreed_form_and_keep_what_was_skipped() -> None:
    finding = Finding(
        rule="VF-C01",
        severity=Severity.ERROR,
        message="too close",
        measured=np.float64(2.5),
        limit=3.0,
        unit="mm",
        branches=("0.0", "0.1"),
        x_mm=1.0,
        y_mm=2.0,
        marker_wkt="POINT (1 2)",
        fingerprint="abc",
        waived=True,
        reason="a coupon",
    )
    endless = Finding(rule="VF-P03", severity=Severity.INFO, message="-", measured=float("inf"))
    report = CheckReport(
        design="y",
        recipe="r",
        run=(RuleRun(rule="VF-C01", checked=3, findings=1),),
        skipped=(RuleSkipped(rule="VF-R03", reason="needs a map"),),
        findings=(finding, endless),
        stale_waivers=("old",),
    )
    read = json.loads(checks_text(report))
    assert (read["schema"], read["units"]) == ("vinefab/checks-1", "mm")
    assert (read["design"], read["recipe"]) == ("y", "r")
    assert read["rules_run"] == [{"id": "VF-C01", "checked": 3, "findings": 1}]
    assert read["rules_skipped"] == [{"id": "VF-R03", "reason": "needs a map"}]
    assert read["stale_waivers"] == ["old"]
    first, second = read["findings"]
    assert first == {
        "id": "VF-C01",
        "severity": "error",
        "title": "",
        "message": "too close",
        "measured": 2.5,
        "limit": 3.0,
        "unit": "mm",
        "branches": ["0.0", "0.1"],
        "names": [],
        "x_mm": 1.0,
        "y_mm": 2.0,
        "marker_wkt": "POINT (1 2)",
        "fingerprint": "abc",
        "waived": True,
        "reason": "a coupon",
    }
    assert second["measured"] is None
