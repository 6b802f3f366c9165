"""The half-angle of a surface from a table: likelihood, coverage, and what is refused."""

import itertools
import json
import math
import tomllib

import numpy as np
import pytest

from vinefab.cli.main import main
from vinefab.core.errors import BadInputError
from vinefab.model.contacts import read_contacts
from vinefab.observation.surface_fit import Trials, fit_contact_table

ANGLES = np.arange(5.0, 41.0, 5.0)
FOUND = 0.9
"""Share of campaigns whose interval must hold the truth."""


def counts(stopped, tried=5, angles=ANGLES):
    return Trials(angles_deg=tuple(angles), stopped=tuple(stopped), tried=(tried,) * len(stopped))


def log_likelihood_by_hand(stopped, tried, place, steps=41):
    """The same by trying every falling course of shares on a grid: an independent, slow oracle."""
    grid, best = np.linspace(0.0, 1.0, steps), -math.inf
    for course in itertools.combinations_with_replacement(grid[::-1], len(stopped)):
        halves = [p >= 0.5 if index < place else p <= 0.5 for index, p in enumerate(course)]
        if all(halves):
            terms = [
                (held * math.log(p) if held else 0.0)
                + ((n - held) * math.log(1.0 - p) if n > held else 0.0)
                for held, n, p in zip(stopped, tried, course, strict=True)
                if (p > 0.0 or not held) and (p < 1.0 or n == held)
            ]
            best = max(best, sum(terms)) if len(terms) == len(stopped) else best
    return best


@pytest.mark.parametrize("stopped", [(4, 1, 0), (2, 3, 1), (0, 2, 4), (4, 4, 4), (3, 4, 0)])
def test_the_likelihood_is_the_greatest_of_all_falling_courses(stopped):
    tried = (4, 4, 4)
    found = Trials(angles_deg=(5.0, 10.0, 15.0), stopped=stopped, tried=tried).log_likelihoods()
    for place in range(4):
        # The grid has quarters, halves and many pooled shares, not all of them.
        slow = log_likelihood_by_hand(stopped, tried, place)
        assert slow - 1e-9 <= found[place] <= slow + 0.01


def test_a_sharp_threshold_is_found_between_the_angles_around_it():
    angle = counts((5, 5, 0, 0, 0, 0, 0, 0)).half_angle
    assert (angle.low, angle.value, angle.high) == (10.0, 12.5, 15.0)


def test_where_half_of_the_tips_stop_is_the_half_angle():
    even = Trials(angles_deg=(10.0, 20.0, 30.0), stopped=(6, 3, 0), tried=(6, 6, 6))
    assert even.half_angle.value == 20.0
    between = Trials(angles_deg=(10.0, 20.0), stopped=(9, 3), tried=(10, 10))
    assert between.half_angle.value == pytest.approx(10.0 + 10.0 * 0.4 / 0.6, abs=0.01)


def test_without_both_outcomes_there_is_a_bound_alone():
    grew = counts((0,) * 8).half_angle
    assert (grew.low, grew.value, grew.high) == (0.0, None, 5.0)
    stopped = counts((5,) * 8).half_angle
    assert (stopped.low, stopped.value, stopped.high) == (40.0, None, 90.0)
    once = counts((0, 0, 0), tried=1, angles=(5.0, 10.0, 15.0)).half_angle
    # Two tips that grew on, each with chance 1/2, are not rare enough: 2.77 against 2.706 are.
    assert once.high == 10.0


def held(campaigns, spread_deg, first=0):
    """How many campaigns hold the truth; thresholds of tips scatter around it."""
    found = 0
    for number in range(first, first + campaigns):
        rng = np.random.default_rng(number)
        truth = rng.uniform(3.0, 38.0)
        angles = np.repeat(ANGLES, 5)
        stopped = angles <= truth + rng.normal(0.0, spread_deg, len(angles))
        angle = Trials.of(angles, stopped).half_angle
        found += angle.low <= truth <= angle.high
    return found


@pytest.mark.parametrize("spread_deg", [0.0, 4.0])
def test_few_campaigns_hold_the_truth(spread_deg):
    assert held(30, spread_deg) >= 27


@pytest.mark.thorough
@pytest.mark.parametrize("spread_deg", [0.0, 1.0, 2.0, 4.0, 6.0])
def test_two_hundred_campaigns_hold_the_truth(spread_deg):
    assert held(200, spread_deg, first=1000) >= FOUND * 200


def test_campaigns_whose_shares_are_logistic_hold_it_too():
    found = 0
    for number in range(40):
        rng = np.random.default_rng(number)
        truth, scale = rng.uniform(8.0, 30.0), rng.uniform(1.0, 5.0)
        share = 1.0 / (1.0 + np.exp((ANGLES - truth) / scale))
        stopped = rng.binomial(5, share)
        angle = counts(stopped).half_angle
        found += angle.low <= truth <= angle.high
    assert found >= 36


# --- as a command


@pytest.fixture
def table(tmp_path):
    def write(text):
        path = tmp_path / "contacts.csv"
        path.write_text(text)
        return path

    return write


HEAD = "angle_from_head_on_deg,grew_on,surface\n"
TWO = HEAD + "5,no,a\n5,no,a\n20,yes,a\n20,yes,a\n5,yes,b\n10,YES,b\n15,,b\n"


def test_surfaces_are_fitted_apart_and_added_to_what_a_file_holds(table, tmp_path, capsys):
    out = tmp_path / "mine.toml"
    out.write_text(
        'schema = "vinefab/contacts-1"\n[emergence]\nlow = 0.7\nhigh = 1.0\ncount = 9\ntried = 9\n'
        'pressure_kpa = 20.0\nsource = "ours"\n[[surfaces]]\nsurface = "c"\ncontacts = 1\n'
        'source = "before"\nhalf_angle_deg = { low = 1.0, high = 2.0 }\n'
    )
    call = ["fit-observations", str(table(TWO)), "--out", str(out), "--force", "--json", "-"]
    assert main([*call, "--tube-diameter-mm", "10.2", "--film", "LDPE"]) == 0
    words = capsys.readouterr().out
    found = json.loads(words[words.index("{") : words.rindex("}") + 1])
    a, b = found["surfaces"]
    assert (a["surface"], a["contacts"], b["surface"], b["contacts"]) == ("a", 4, "b", 2)
    assert a["half_angle_deg"] == {"value": 12.5, "low": 0.0, "high": 90.0}
    assert b["half_angle_deg"]["value"] is None
    again = read_contacts(out)
    assert [one.surface for one in again.surfaces] == ["c", "a", "b"]
    assert again.emergence.count == 9
    assert again.surfaces[1].tube_diameter_mm == 10.2
    assert tomllib.loads(out.read_text())["surfaces"][1]["film"] == "LDPE"
    # Fitted again, a surface takes the place of its earlier one.
    assert main(call) == 0
    assert [one.surface for one in read_contacts(out).surfaces] == ["c", "a", "b"]


def test_what_is_odd_is_noted(table):
    rising = fit_contact_table(table("angle_from_head_on_deg,grew_on\n5,yes\n20,no\n40,no\n"))
    (surface,) = rising.surfaces
    assert surface.surface == "coupon"
    text = "\n".join(rising.summary)
    assert "angles may have been measured from the wall's tangent" in text
    assert "few contacts (3, from 20 on)" in text
    noted = fit_contact_table(table("day,angle_from_head_on_deg,grew_on\n1,5,no\n1,9,\n2,20,yes\n"))
    assert "columns left alone: day" in noted.notes
    assert "1 row without an answer" in noted.notes


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no row says whether a tip grew on"),
        (HEAD + "5,,a\n", "no row says whether a tip grew on"),
        (HEAD + "5,maybe,a\n", "line 2: grew_on is 'maybe'; allowed: yes, no"),
        (HEAD + "x,yes,a\n", "line 2: angle_from_head_on_deg is 'x'; allowed: 0 to 90 deg"),
        (HEAD + "95,yes,a\n", "line 2: angle_from_head_on_deg is 95"),
        (HEAD + "nan,yes,a\n", "line 2: angle_from_head_on_deg is nan"),
        (HEAD + "\n\n,yes,a\n", "line 4: angle_from_head_on_deg is missing"),
        ("angle,grew_on\n5,yes\n", "does not name the column angle_from_head_on_deg"),
        ("angle_from_head_on_deg,grew_on,surfaces\n5,yes,a\n", "did you mean 'surface'"),
        ("angle_from_head_on_deg,grew_on,grew_on\n5,yes,no\n", "a column is there twice"),
        (HEAD + '5,"yes,a\n', "line 2: the line cannot be read as cells"),
    ],
)
def test_a_wrong_table_is_one_clear_line(table, text, words):
    with pytest.raises(BadInputError) as raised:
        fit_contact_table(table(text))
    assert words in str(raised.value)
    assert len(str(raised.value).splitlines()) == 1


def test_a_table_goes_alone(table, capsys):
    path = str(table(TWO))
    assert main(["fit-observations", path, path]) == 2
    assert "is a table of contacts, given with other files" in capsys.readouterr().err
    assert main(["fit-observations", "seen.json", "--film", "LDPE"]) == 2
    assert "film goes with a table of contacts" in capsys.readouterr().err
