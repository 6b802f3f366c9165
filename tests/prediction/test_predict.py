"""The whole report of a design, read as a page, against its JSON."""

import base64
import itertools
import json
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import pytest

from vinefab.model.files.design_toml import read_design
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.prediction.family_deployments import PredictionPlan, map_families, unseen_maps
from vinefab.prediction.predict import predict
from vinefab.prediction.prediction_json import prediction_text
from vinefab.prediction.provenance import origin_of

EMPTY = ("meta", "img", "link", "br")
"""Elements that are never closed."""


class Page(HTMLParser):
    """Everything that is checked about a page."""

    def __init__(self, text):
        super().__init__()
        self.addresses, self.images, self.headings = [], [], []
        self.ids, self.anchors, self.words = [], [], []
        self.open, self.problems = [], []
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
        if tag in ("script", "iframe", "object", "embed", "link", "form"):
            self.problems.append(f"has a {tag}")
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.problems.append(f"closes {tag} out of order")

    def handle_data(self, data):
        if self.open and self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())

    @property
    def drawings(self):
        """The embedded pictures as bytes."""
        return [base64.b64decode(image["src"].partition("base64,")[2]) for image in self.images]


MOST_BYTES = 3_000_000
"""A page of a mid-sized design; it has to go through mail and open on a phone."""


@pytest.fixture(scope="module")
def made():
    design, profile = read_design("grid_explorer"), read_profile(DEFAULT_RECIPE)
    small = {"columns": 3, "rows": 3, "size_mm": 300.0}
    given = unseen_maps("grid", 1, 9, small).worlds
    families = map_families(given, unseen_maps("grid", 4, 0, small))
    found = predict(design, profile, families, PredictionPlan(poses=2, seed=1))
    origin = origin_of("vinefab report grid_explorer --seed 1", [design], profile, families)
    text = found.page(origin)
    return text, Page(text), json.loads(prediction_text(found, origin))


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


def test_headings_descend_one_by_one_and_contents_lead_to_them(made):
    _, page, _ = made
    assert page.headings[0] == 1
    assert page.headings.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(page.headings))
    assert len(set(page.ids)) == len(page.ids)
    assert [anchor[1:] for anchor in page.anchors] == page.ids
    for title in ("Pressure window", "Predictions", "Deployments", "Sensitivity", "Design rules"):
        assert title in page.text


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
    for name in ("head_on_half_angle_deg", "fitted_diameter_mm", "burst_width_mm", "buffer_mm"):
        assert name in page.text
    for standing in ("assumed", "published", "paper", "computed", "simulated"):
        assert standing in page.text
