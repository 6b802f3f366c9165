"""The panels of many maps and of the comparison, in a real browser with stored answers."""

import copy

import numpy as np
import pytest

from tests.studio.conftest import TabSession
from tests.studio.test_family_answers import heat_share
from vinefab.model.design import Design, design_content
from vinefab.studio.executors import answer_of
from vinefab.studio.file_exports import snapshot_html

STATE = {
    "design": design_content(Design.read("plain_vine")),
    "map": {"source": {"environment": "pegs", "seed": 1}, "edits": []},
    "pose": None,
    "recipe": None,
    "task": "reach",
    "family": {"environment": "pegs", "count": 4, "seed": 20},
    "growth": {},
    "locks": [],
}

FAKE = """async () => {
  const {createStore} = await import("studio/store.js");
  const {mount} = await import("studio/family_panel.js");
  const compare = await import("studio/compare.js");
  const stored = structuredClone({state: studio.store.get(), answers: studio.answers});
  const state = structuredClone(stored.state);
  const listeners = {}, told = [], asked = [];
  const app = {
    store: createStore(state), answers: {}, live: true, reference: null, previewed: null,
    file: {saved_design: structuredClone(state.design)},
    shown: () => app.store.get(), say: () => {}, on: () => {}, onProgress: () => {},
    onPreview: () => {}, onReference: (fn) => told.push(fn), cancel: () => {},
    setReference: (reference) => {
      app.reference = reference;
      told.forEach((fn) => fn(reference));
    },
    onAnswer: (panel, fn) => (listeners[panel] ??= []).push(fn),
    ask: async (panel, ask, {state: given} = {}) => {
      asked.push([panel, structuredClone(ask)]);
      const answer = structuredClone(stored.answers[panel === "before" ? "live" : panel]);
      if (panel === "family") {
        answer.quick = Boolean(ask.quick);
        for (const entry of answer.maps) if (ask.have.includes(entry.key)) entry.ground_svg = null;
      }
      if (panel !== "before") app.put(panel, answer);
      return answer;
    },
    put: (panel, answer) => {
      app.answers[panel] = answer;
      for (const fn of listeners[panel] ?? []) fn(answer, app.store.get());
    },
  };
  const family = document.getElementById("family"), strip = document.getElementById("compare");
  family.replaceChildren();
  strip.replaceChildren();
  family.hidden = strip.hidden = false;
  strip.open = true;
  compare.mount(strip, app);
  mount(family, app);
  globalThis.fake = {app, asked, stored};
}"""

MINUS, DASH = "\u2212", "\u2013"
RESTED_MS = 600
"""After so long a version counts as one that rested."""


@pytest.fixture(scope="module")
def answers():
    names = ("live", "rules", "family")
    return {name: answer_of(name, copy.deepcopy(STATE), {}) for name in names}


@pytest.fixture(scope="module")
def module_tab(open_context, answers, tmp_path_factory):
    """One page for all, with a clock that goes on as a test says; each mounts panels of its own."""
    path = tmp_path_factory.mktemp("family") / "snapshot.html"
    path.write_bytes(snapshot_html(STATE, answers))
    tab = TabSession(open_context().new_page())
    tab.page.clock.install()
    return tab.open(path.as_uri())


@pytest.fixture
def tab(module_tab):
    yield module_tab
    assert module_tab.problems == []


@pytest.fixture
def page(tab):
    return tab.page


def test_a_snapshot_shows_every_map_and_where_bodies_lie(page, answers):
    page.click("#tab-family")
    page.wait_for_selector(".tile .robot")
    family = answers["family"]
    values = page.locator(".tile .value").all_text_contents()
    assert values == [f"{entry['score']:.3f}" for entry in family["maps"]]
    assert (
        page.locator(".tile svg .ground").count() == page.locator(".tile svg .robot").count() == 4
    )
    words = page.locator("#family .summary").first.text_content()
    assert f"reach, mean {family['distribution']['mean']:.3f}" in words
    assert "over 4 maps" in words
    assert "simulated" in words
    page.click("[data-view=heat]")
    painted = page.evaluate("""() => {
      const canvas = document.querySelector(".heat-plate canvas");
      const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      return [...data].filter((_, at) => at % 4 === 3).map((alpha, at) => (alpha ? at : -1));
    }""")
    # The picture's rows run from above, those of the answer from below.
    shown = np.flatnonzero(heat_share(family["heat"])[::-1].ravel())
    assert [at for at in painted if at >= 0] == shown.tolist()
    page.focus(".heat-plate canvas")
    page.keyboard.press("ArrowUp")
    assert "% of 4 maps" in page.locator(".heat .here").text_content()


def asked_quickly(tab, count):
    """Return whether each of so many questions of many maps is a quick one, and the last."""
    of_family = "fake.asked.filter(([panel]) => panel === 'family')"
    tab.until(f"(count) => {of_family}.length >= count", count)
    asked = tab.page.evaluate(of_family)
    tab.page.evaluate("fake.asked.splice(0)")
    return [ask.get("quick", False) for _, ask in asked], asked[-1][1]


def test_a_drag_is_followed_quickly_and_a_rest_in_full(tab, page):
    page.evaluate(FAKE)
    assert asked_quickly(tab, 1)[0] == [False]
    page.evaluate("fake.app.put('live', structuredClone(fake.stored.answers.live))")
    page.clock.run_for(RESTED_MS)
    for length in (150, 151, 152):
        page.evaluate(
            "mm => fake.app.store.change('l', (s) => { s.design.trunk.length = mm }, {group: 'g'})",
            length,
        )
    quick, rest = asked_quickly(tab, 4)
    assert quick == [True] * 3 + [False]
    # All grounds are there, and the version before has scores to be compared with.
    assert len(rest["have"]) == len(rest["before"]) == 4
    assert page.locator(".tile .difference").first.text_content() == "="
    # What a snapshot would store is whole, although the last answer had no grounds.
    assert page.evaluate("fake.app.answers.family.maps.every((entry) => entry.ground_svg)")


def test_a_map_is_opened_where_its_robot_was_grown(page, answers):
    page.evaluate(FAKE)
    page.wait_for_selector(".tile .robot")
    page.select_option("#family-sort", "worst")
    scores = page.locator(".tile .value").all_text_contents()
    assert scores == sorted(scores, key=float)
    worst = min(answers["family"]["maps"], key=lambda entry: entry["score"])
    page.locator(".tile button").first.click()
    opened = page.evaluate("fake.app.store.get()")
    assert opened["map"] == {"source": worst["source"], "edits": []}
    assert opened["pose"] == worst["pose"]


def test_the_version_before_is_the_one_that_rested(page):
    page.evaluate(FAKE)
    page.evaluate("""() => {
      for (const name of ["live", "rules"]) fake.app.put(name, fake.stored.answers[name]);
    }""")
    page.clock.run_for(RESTED_MS)
    first = page.evaluate("fake.app.store.get().design.trunk.length")
    change = """([mm, better]) => {
      fake.app.store.change("l", (s) => { s.design.trunk.length = mm; });
      const live = structuredClone(fake.stored.answers.live);
      live.scores.reach += better;
      live.facts.pressure_needed_kpa += 1;
      fake.app.put("live", live);
    }"""
    page.evaluate(change, [111, 0.01])
    page.evaluate(change, [122, 0.02])
    assert page.evaluate("fake.app.reference.design.trunk.length") == first
    cells = "[...document.querySelectorAll('[data-measure=%s] td')].map((td) => td.textContent)"
    assert page.evaluate(cells % "score-reach")[2] == "+0.020better"
    assert page.evaluate(cells % "pressure")[2] == "+1.0worse"
    assert page.evaluate(cells % "score-coverage")[2] == "="
    page.clock.run_for(RESTED_MS)
    page.evaluate(change, [133, -0.01])
    assert page.evaluate("fake.app.reference.design.trunk.length") == 122
    assert page.evaluate(cells % "score-reach")[2] == f"{MINUS}0.030worse"
    page.click("#keep-reference")
    assert page.evaluate("fake.app.reference") is None
    page.clock.run_for(RESTED_MS)
    page.evaluate(change, [144, 0.0])
    page.evaluate(change, [155, 0.0])
    assert page.evaluate("fake.app.reference.design.trunk.length") == 133
    page.select_option("#compare-with", "saved")
    assert page.evaluate("fake.app.reference.design.trunk.length") == first


def test_on_another_map_the_version_before_is_grown_again(tab, page):
    page.evaluate(FAKE)
    page.evaluate("fake.app.put('live', structuredClone(fake.stored.answers.live))")
    page.clock.run_for(RESTED_MS)
    page.evaluate("fake.app.store.change('l', (s) => { s.design.trunk.length = 111; })")
    page.evaluate("fake.app.put('live', structuredClone(fake.stored.answers.live))")
    page.evaluate("fake.app.store.change('m', (s) => { s.map.source.seed = 2; })")
    cell = "document.querySelector('[data-measure=score-reach] td').textContent"
    assert page.evaluate(cell) == DASH
    tab.until("() => fake.asked.some(([panel]) => panel === 'before')")
    tab.until(f"(dash) => {cell} !== dash", DASH)


def test_a_mean_that_differs_by_chance_is_neither_better_nor_worse(page):
    kinds = page.evaluate("""async () => {
      const {comparedCell} = await import("studio/compare.js");
      const {isClear} = await import("studio/family_panel.js");
      const measure = {
        better: 1, digits: 3, of: (found) => found.mean,
        isUnclear: (found) => !isClear(found.difference),
      };
      const kind = (low, high) =>
        comparedCell(measure, {mean: 0.51, difference: {low, high}}, {mean: 0.5}, true).kind;
      return [kind(-0.01, 0.03), kind(0.004, 0.016), kind(null, null)];
    }""")
    assert kinds == ["no clear difference", "better", "no clear difference"]
