"""The whole report of a design, read as a page, against its JSON."""

import base64
import itertools
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest

from vinefab.model.design import Build, Design
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.finding import CheckReport, Finding, RuleSkipped, Severity
from vinefab.model.laser import RecipeStatus, read_profile
from vinefab.model.quantity import Standing
from vinefab.model.score import HARDLY_GROWN, NOTHING_TOUCHED, Failures
from vinefab.physics.tube import self_weight_span_mm
from vinefab.prediction.family_deployments import (
    PredictionPlan,
    map_families,
    origin_of,
    spread_blocks,
    unseen_maps,
)
from vinefab.prediction.measures import (
    GROWN,
    MEASURES,
    REACH,
    SEEN,
    STUCK,
    TOUCHED,
    UNDEPLOYED,
    MeasureTable,
)
from vinefab.prediction.predict import (
    cautions,
    failures,
    measured,
    predict,
    span_notes,
    verdict_on,
)
from vinefab.prediction.pressure_window import LevelPressure, Need, PressureWindow

EMPTY = ("meta", "img", "link", "br")
"""Elements that are never closed."""


class Page(HTMLParser):
    """Everything that is checked about a page."""

    def __init__(self, text):
        super().__init__()
        self.addresses, self.images, self.headings = [], [], []
        self.ids, self.anchors, self.words = [], [], []
        self.open, self.problems, self.folds, self.read_first = [], [], 0, []
        self.feed(text)
        if self.open:
            self.problems.append(f"left open: {self.open}")

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if "id" in given:
            self.ids.append(given["id"])
        if tag == "a":
            self.anchors.append(given["href"])
        elif tag == "img":
            self.images.append(given)
        self.addresses += [v for k, v in attrs if k in ("src", "href", "srcset", "action")]
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        if tag in ("iframe", "object", "embed", "link", "form"):
            self.problems.append(f"has a {tag}")
        self.folds += tag == "details"
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.problems.append(f"closes {tag} out of order")

    def handle_data(self, data):
        if not self.open or self.open[-1] in ("style", "script"):
            return
        self.words.append(data)
        if "details" not in self.open or "summary" in self.open:
            self.read_first += data.split()

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())

    @property
    def drawings(self):
        """The embedded pictures as bytes."""
        return [base64.b64decode(image["src"].partition("base64,")[2]) for image in self.images]


SVG = "{http://www.w3.org/2000/svg}"

MOST_BYTES = 3_000_000
"""A page of a mid-sized design; it has to go through mail and open on a phone."""


@pytest.fixture(scope="module")
def made():
    design, profile = Design.read("grid_explorer_levels"), read_profile(DEFAULT_RECIPE)
    small = {"columns": 3, "rows": 3, "size_mm": 300.0}
    given = unseen_maps("grid", 1, 9, small).worlds
    families = map_families(given, unseen_maps("grid", 4, 0, small))
    found = predict(design, profile, families, PredictionPlan(poses=2, seed=1))
    origin = origin_of("vinefab report grid_explorer_levels --seed 1", [design], profile, families)
    found = replace(found, origin=origin)
    with pytest.MonkeyPatch.context() as patch:
        built = []
        patch.setattr(
            "vinefab.prediction.predict.spread_blocks",
            lambda tables: built.append(1) or spread_blocks(tables),
        )
        text, numbers = found.page(), found.numbers
    assert built == [1], "the view is built once for the page and the JSON"
    return text, Page(text), numbers


def numbers_of(value, key=""):
    """Yield every number of a JSON document with its key."""
    if isinstance(value, bool) or value is None:
        return
    if isinstance(value, dict):
        for name, part in value.items():
            yield from numbers_of(part, name)
    elif isinstance(value, list):
        for part in value:
            yield from numbers_of(part, key)
    elif isinstance(value, int | float):
        yield key, value


def test_page_is_whole_and_needs_nothing_else(made):
    text, page, _ = made
    assert page.problems == []
    assert all(address.startswith(("data:image/", "#")) for address in page.addresses)
    assert not re.search(r"url\(|@import|https?://", text)
    assert all(image["alt"] for image in page.images)
    assert len(text.encode()) < MOST_BYTES


def test_headings_descend_one_by_one_and_what_is_not_read_first_is_folded(made):
    _, page, _ = made
    assert page.headings[0] == 1
    assert page.headings.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(page.headings))
    assert len(set(page.ids)) == len(page.ids)
    for title in ("Pressure window", "Predictions", "Deployments", "Sensitivity", "Design rules"):
        assert title in page.text
    assert len(page.read_first) <= 900
    assert page.folds > 10


def test_type_in_figures_is_readable(made):
    _, page, _ = made
    for image, drawing in zip(page.images, page.drawings, strict=True):
        document = ET.fromstring(drawing)  # noqa: S314  our own text
        px = int(image["width"]) / float(document.get("viewBox").split()[2])
        sizes = [float(one.get("font-size")) * px for one in document.iter(f"{SVG}text")]
        assert min(sizes, default=11.0) >= 10.9, image["alt"]


def test_the_median_map_comes_first_then_worst_and_best(made):
    _, page, _ = made
    seen = [float(re.search(r"sees ([\d.]+) %", page.images[k]["alt"])[1]) for k in range(3)]
    assert [seen[k] for k in (1, 0, 2)] == sorted(seen)
    assert [image.get("data-file") for image in page.images[:4]] == [
        "median", "worst", "best", "contacts"
    ]  # fmt: skip
    # One legend, below the first, explains the row.
    assert [b">level 1<" in drawing for drawing in page.drawings[:3]] == [True, False, False]


def test_pictures_are_drawings_without_addresses(made):
    _, page, _ = made
    assert len(page.drawings) > 15
    for drawing in page.drawings:
        assert not re.search(rb'(href|src)="(?!#|data:)', drawing)
        assert ET.fromstring(drawing).tag.endswith("svg")  # noqa: S314  our own text


def test_every_number_of_the_json_is_on_the_page(made):
    _, page, document = made
    shown = set(re.findall(r"\d+(?:\.\d+)?", page.text))
    as_numbers = {float(number) for number in shown}
    missing = [(key, value) for key, value in numbers_of(document) if abs(value) not in as_numbers]
    assert missing == []
    assert sum(1 for _ in numbers_of(document)) > 300


def test_json_says_what_and_where_from(made):
    _, page, document = made
    assert document["schema"] == "vinefab/prediction-1"
    assert [family["label"] for family in document["fields"]] == [
        "the map given",
        "4 unseen grid maps",
    ]
    assert len(document["fields"][1]["deployments"]) == 8
    assert document["verdict"] in page.text
    assert document["reproduce"]["command"] in page.text
    for fingerprint in document["reproduce"]["inputs"].values():
        assert fingerprint in page.text


def test_every_assumption_has_a_standing(made):
    _, page, _ = made
    for name in ("head_on_half_angle_deg", "fitted_diameter_mm", "survived_width_mm", "buffer_mm"):
        assert name in page.text
    for standing in ("assumed", "published", "paper", "computed", "simulated"):
        assert standing in page.text


def check(*findings, skipped=()):
    return CheckReport(design="d", recipe="r", run=(), skipped=skipped, findings=findings)


def found_rule(rule, severity):
    return Finding(rule=rule, severity=severity, message="m")


def window_of_needs(loose_kpa, tight_kpa, allowed_kpa, working_kpa):
    def need(storage, p95_kpa):
        return Need(
            storage=storage, p05_kpa=1.0, median_kpa=2.0, p95_kpa=p95_kpa, greatest_kpa=99.0,
            enough_percent=50.0,
        )  # fmt: skip

    limits = [
        LevelPressure(
            name="trunk", level=1, width_mm=20.0, inflated_mm=12.7, burst_kpa=1.5 * kpa,
            allowed_kpa=kpa, strain_percent=1.0,
        )
        for kpa in (allowed_kpa, allowed_kpa + 5.0)
    ]  # fmt: skip
    return PressureWindow(
        loose=need("loosely", loose_kpa), tight=need("tightly", tight_kpa),
        working_kpa=working_kpa, levels=tuple(limits), safety_factor=1.5,
        standing=Standing.ASSUMED,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("report", "window", "tone", "words"),
    [
        (
            check(found_rule("VF-W01", Severity.ERROR), found_rule("VF-C01", Severity.WARNING)),
            window_of_needs(10.0, 20.0, 30.0, 15.0),
            "bad",
            "not manufacturable and deployable as designed: broken rules VF-W01.",
        ),
        (check(), None, "bad", "manufacturable, but has no room to emerge"),
        (
            check(),
            window_of_needs(30.0, 60.0, 20.0, 15.0),
            "bad",
            "needs 30.0 kPa even with film stored loosely, and its widest part is limited to 20.0",
        ),
        (
            check(),
            window_of_needs(10.0, 20.0, 30.0, 35.0),
            "caution",
            "deployable at 10.0 to 30.0 kPa; its working pressure of 35 kPa is outside",
        ),
        (check(), window_of_needs(10.0, 40.0, 30.0, 15.0), "caution", "at 10.0 to 30.0 kPa with"),
        (check(), window_of_needs(10.0, 20.0, 30.0, 15.0), "plain", "at 10.0 to 30.0 kPa with"),
    ],
)
def test_verdicts_follow_from_rules_and_window(report, window, tone, words):
    text, found = verdict_on(report, window)
    assert found == tone
    assert words in text
    assert "unverified" not in text


def test_no_verdict_is_good_over_an_unverified_recipe():
    window = window_of_needs(10.0, 20.0, 30.0, 15.0)
    text, tone = verdict_on(check(), window, "laser recipe unverified")
    assert tone == "caution"
    assert "manufacturable by the rules (laser recipe unverified), and deployable" in text
    closed = window_of_needs(30.0, 60.0, 20.0, 15.0)
    assert verdict_on(check(), closed, "laser recipe unverified")[1] == "bad"


def known_outcomes(maps=("a", "a", "a", "b")):
    columns = {m.key: np.full(len(maps), np.nan) for m in MEASURES}
    columns[SEEN.key] = np.array([10.0, 20.0, 30.0, 60.0])
    columns[REACH.key] = np.array([5.0, 5.0, 5.0, 5.0])
    columns[STUCK.key] = np.array([10.0, 10.0, 10.0, 10.0])
    columns[UNDEPLOYED.key] = np.array([9.9, 9.9, 9.9, 9.9])
    return MeasureTable(label="two maps", map_names=maps, poses=(None,) * len(maps), values=columns)


def test_the_headline_of_a_measure_is_its_spread():
    seen = measured(known_outcomes(), SEEN)
    # Maps of mean 20 and 60; deployments 10, 20, 30, 60.
    assert (seen.value, seen.detail, seen.standing) == (
        "sees 40.0 %", "[0.0, 100.0; 2 maps]; 90 % of deployments 11.5 to 55.5", "simulated"
    )  # fmt: skip


@pytest.mark.parametrize(
    ("grown", "words", "interval", "tone"),
    [
        ([50.0, 60.0, 70.0, 80.0], "0 of 4", (0.0, 0.842), "plain"),
        # A quarter of the deployments, a sixth of the maps' means: of two maps 0.33 have failed.
        ([9.9, 60.0, 70.0, 80.0], "1 of 4", (0.0, 0.911), "bad"),
    ],
)
def test_complete_failures_are_counted_over_maps(grown, words, interval, tone):
    outcomes = known_outcomes()
    outcomes = replace(outcomes, values={**outcomes.values, GROWN.key: np.array(grown)})
    fact = failures(outcomes).fact
    assert (fact.value, fact.tone) == (words, tone)
    ends = fact.data["percent_low"] / 100.0, fact.data["percent_high"] / 100.0
    assert ends == pytest.approx(interval, abs=0.002)


def test_cautions_name_counts_and_pressures():
    profile = read_profile(DEFAULT_RECIPE)
    skipped = tuple(RuleSkipped(rule=f"VF-{n}", reason="no map") for n in range(3))
    warnings = (found_rule("VF-C01", Severity.WARNING), found_rule("VF-C02", Severity.INFO))
    design = Design.read("plain_vine")
    prepared = SimpleNamespace(
        report=check(*warnings, skipped=skipped), profile=profile, design=design
    )
    window = window_of_needs(10.0, 40.0, 30.0, 15.0)
    sentences = cautions(prepared, window, known_outcomes())
    assert profile.recipe.status is RecipeStatus.UNVERIFIED
    assert sentences[0].startswith("No coupon")
    assert "needs 40.0 kPa, more than the 30.0 kPa" in sentences[1]
    assert sentences[2].startswith("Pressures rest on assumed numbers")
    assert sentences[3] == "10.0 % of its branches get stuck (simulated)."
    assert sentences[4].startswith("Predictions rest on 2 maps")
    assert len(sentences) == 5


@pytest.mark.parametrize(("share", "noted"), [(0.99, False), (1.01, True)])
def test_branches_that_fold_under_their_own_weight_are_named(share, noted):
    profile = read_profile(DEFAULT_RECIPE)
    film, build = profile.material, Build.standard(1).changed(pressure_kpa=30.0)
    span_mm = self_weight_span_mm(
        30.0, build.widths_mm[0], film.ply_mm.value, film.density_kg_m3.value
    )
    design = Design(name="v", trunk_length_mm=share * span_mm, build=build)
    notes = span_notes(SimpleNamespace(design=design, profile=profile))
    assert len(notes) == noted
    assert all(f"from about {span_mm:.0f} mm without support" in note for note in notes)


@pytest.mark.parametrize(
    ("touched", "grown", "failed", "what"),
    [
        ([0.0, 50.0, 0.0], [100.0, 1.0, 1.0], [1, 0, 1], NOTHING_TOUCHED),
        ([np.nan] * 3, [100.0, 1.0, 1.0], [0, 1, 1], HARDLY_GROWN),
        (
            [0.0, np.nan, np.nan],
            [100.0, 100.0, 1.0],
            [1, 0, 1],
            f"{NOTHING_TOUCHED}; on maps without targets, {HARDLY_GROWN}",
        ),
    ],
)
def test_a_deployment_fails_where_it_touches_nothing_or_without_targets_hardly_grows(
    touched, grown, failed, what
):
    values = {TOUCHED.key: np.array(touched), GROWN.key: np.array(grown)}
    table = MeasureTable(label="l", map_names=("a", "b", "c"), poses=(None,) * 3, values=values)
    assert failures(table) == Failures.of(np.array(failed, dtype=bool), table.map_names, what)
