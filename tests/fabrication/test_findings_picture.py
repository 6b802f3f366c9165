import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely

from tests.pages.drawn import placed_texts, texts_of
from vinefab.fabrication.checking import check_design
from vinefab.fabrication.findings_picture import (
    MOST_LISTED,
    SEVERITY_COLOURS,
    FindingsPage,
    findings_picture,
    listed,
)
from vinefab.model.design import Build, Design, Level
from vinefab.model.finding import CheckReport, Finding, Severity
from vinefab.model.laser import read_profile
from vinefab.pages.page_files import page_png, page_svg
from vinefab.pages.panel import fitted, rgb, text_width

CALM = CheckReport(design="any", recipe="any", run=(), skipped=(), findings=())

HOSTILE = "cost $\\foo$ <script>&amp; %s\x07 \u202e 樹 " * 40


def _tree(*fans, **build):
    plain = Build.standard(1 + len(fans))
    levels = tuple(
        Level(branches=n, length_mm=length, fan_rad=math.radians(deg)) for n, length, deg in fans
    )
    return Design(name="case", trunk_length_mm=300.0, levels=levels, build=plain.changed(**build))


DESIGNS = {
    "plain": _tree(),
    "tapered": _tree((3, 200.0, 120.0), taper=(0.7, 0.8)),
    "forty": _tree((3, 220.0, 150.0), (3, 160.0, 70.0), (3, 90.0, 40.0)),
    "overlaps": _tree((3, 60.0, 30.0), (3, 60.0, 200.0), tail_mm=100.0),
    "webbed": _tree((4, 150.0, 40.0), fillet_mm=(20.0,)),
}


@pytest.fixture(scope="module")
def recipe():
    return read_profile("co2_60w__stretchlon_200")


def _scattered(count):
    """Return a report with findings of three rules all over the place, some of them on a point."""
    rng = np.random.default_rng(5)
    places = rng.uniform((-150.0, -60.0), (400.0, 60.0), (count, 2)).round(1)
    places[: count // 4] = places[:1]
    found = tuple(
        Finding(
            rule=f"VF-X{row % 3:02d}",
            severity=list(Severity)[row % 3],
            message="too close: move it away " * 20,
            measured=1.0 + row,
            limit=3.0,
            unit="mm",
            branches=("0.0.1", "0.0.2", "0.1", "0.2"),
            x_mm=float(x),
            y_mm=float(y),
        )
        for row, (x, y) in enumerate(places.tolist())
    )
    return replace(CALM, findings=found)


def _signs(tag):
    (x, y) = tag.at_pt
    return shapely.box(x - 4.0, y - 4.0, x + 4.0, y + 4.0)


def _assert_apart(page):
    """Check that no tag, marker or leader lies on another, and all lie in the panel."""
    boxes = [shapely.box(*tag.box_pt) for tag in page.tags]
    signs = [_signs(tag) for tag in page.tags]
    ways = [
        shapely.shortest_line(shapely.Point(tag.at_pt), box)
        for tag, box in zip(page.tags, boxes, strict=True)
    ]
    panel = shapely.box(*page.view.box_pt)
    assert all(panel.covers(box) for box in boxes)
    for a in range(len(boxes)):
        for b in range(len(boxes)):
            assert not boxes[a].intersects(signs[b])
            if a != b:
                assert not boxes[a].intersects(boxes[b])
                assert not signs[a].intersects(signs[b])
                assert not ways[a].intersects(boxes[b])
                assert not ways[a].intersects(signs[b])


def _numbers(page):
    """Return all numbers that stand at a place in the picture."""
    found: set[int] = set()
    for text in (tag.text.split(" (")[0] for tag in page.tags):
        for run in text.split(", "):
            first, _, last = run.partition("-")
            found |= set(range(int(first), int(last or first) + 1))
    return found


@pytest.mark.parametrize("name", DESIGNS)
def test_every_finding_with_a_place_is_numbered_there(name, recipe):
    report = check_design(DESIGNS[name], recipe)
    page = FindingsPage.of(DESIGNS[name], recipe, report)
    _assert_apart(page)
    placed = {line.number for line in page.lines if any(f.x_mm is not None for f in line.findings)}
    assert _numbers(page) == placed


@pytest.mark.parametrize("count", [1, MOST_LISTED, 250])
def test_many_findings_are_grouped_and_none_is_lost(count, recipe):
    report = _scattered(count)
    page = FindingsPage.of(DESIGNS["plain"], recipe, report)
    _assert_apart(page)
    assert sum(len(line.findings) for line in page.lines) == count
    assert _numbers(page) == {line.number for line in page.lines}
    assert len(page.lines) == (count if count <= MOST_LISTED else 3)


@pytest.mark.parametrize(("count", "hostile"), [(0, False), (12, True), (200, True)])
def test_no_text_lies_on_another_or_beyond_the_page(count, hostile, recipe):
    design, report = DESIGNS["forty"], _scattered(count)
    if hostile:
        design = design.changed(name="W" * 100)
        found = tuple(
            replace(f, message=HOSTILE, branches=(HOSTILE,) * 3, rule="MINE-" + "X" * 90)
            for f in report.findings
        )
        report = replace(report, findings=found)
    drawn = findings_picture(design, recipe, report)
    texts = placed_texts(drawn)
    page = shapely.box(0.0, 0.0, drawn.width_pt, drawn.height_pt)
    boxes = [box for _, box in texts]
    assert all(page.contains(box) for box in boxes)
    tree = shapely.STRtree(boxes)
    pairs = [(texts[a][0], texts[b][0]) for a, b in tree.query(boxes, "intersects").T if a < b]
    assert pairs == []
    assert page_svg(drawn).count(b"<script") == 0


def test_a_clean_design_says_so(recipe):
    words = texts_of(findings_picture(DESIGNS["plain"], recipe, CALM))
    assert "No findings: nothing to mark." in words
    # No rule speaks against it, and yet nobody has burst a seam of this recipe.
    assert "no rule forbids it; recipe unverified" in words


def test_errors_come_first_and_waived_findings_are_only_counted(recipe):
    report = _scattered(9)
    waived = tuple(
        replace(f, waived=f.severity is Severity.ERROR, reason="known") for f in report.findings
    )
    assert [line.severity for line in listed(report.findings)][:4] == [Severity.ERROR] * 3 + [
        Severity.WARNING
    ]
    assert len(listed(waived)) == 6
    picture = findings_picture(DESIGNS["plain"], recipe, replace(report, findings=waived))
    assert any("3 waived" in text for text in texts_of(picture))


def test_the_robot_is_large_and_true_to_scale(recipe):
    design = DESIGNS["plain"]
    page = FindingsPage.of(design, recipe, CALM)
    x0, y0, x1, y1 = page.view.geometry(page.robot.lumen).bounds
    assert x1 - x0 > 0.8 * 792.0
    assert y1 - y0 == pytest.approx(design.build.widths_mm[0] * page.view.pt_per_mm)


def test_severities_differ_in_lightness():
    # Rec. 709 luminance of linear light, which every kind of colour vision sees.
    shades = sorted(
        float(np.array([0.2126, 0.7152, 0.0722]) @ (np.array(rgb(colour)) / 255.0) ** 2.2)
        for colour in SEVERITY_COLOURS.values()
    )
    assert all(dark * 1.3 < light for dark, light in pairwise(shades))


def test_long_texts_are_cut_to_their_room():
    short = fitted("a" * 10_000, 100.0, 8.0)
    assert short.endswith("…")
    assert 80.0 < text_width(short, 8.0) <= 100.0
    assert fitted("a\nb", 100.0, 8.0) == "a b"


def test_pictures_are_reproducible(recipe):
    design = DESIGNS["plain"]
    report = check_design(design, recipe)
    one, two = (page_svg(findings_picture(design, recipe, report)) for _ in range(2))
    assert one == two
    assert page_png(findings_picture(design, recipe, report)).startswith(b"\x89PNG")
