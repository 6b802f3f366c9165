"""Several photos together: half-angle, friction, widths; intervals, bounds, two ways, the file."""

import copy
import json
import math
import pickle
import tomllib

import numpy as np
import pytest

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.contacts import read_contacts
from vinefab.model.design import Design
from vinefab.model.map import Pose
from vinefab.observation.contact_fit import fit_files, fit_threshold
from vinefab.physics.anchoring import ASSUMED_FRICTION

DESIGN = "three_level_tree"
RATIO = 1.12
CAMPAIGNS = 200
RADIUS_MM = Design.read(DESIGN).build.widths_mm[0] / math.pi


def drawn(rng, half_angle_deg, count, error_deg=2.0, tip_deg=0.0, photo_deg=0.0, photos=1):
    """Contacts of a campaign: measured angles, whether the tip stopped, and the photo of each."""
    true_deg, photo = rng.uniform(0.0, 60.0, count), np.arange(count) % photos
    shared_deg = rng.normal(0.0, photo_deg, photos) if photo_deg else np.zeros(photos)
    threshold = half_angle_deg + shared_deg[photo] + rng.normal(0.0, tip_deg, count)
    return np.abs(true_deg + rng.normal(0.0, error_deg, count)), true_deg <= threshold, photo


def contact(angle_deg, *, stopped, outcome="", **more):
    outcome = outcome or ("stopped" if stopped else "slid")
    where = {"x_mm": 1.0, "y_mm": 1.0, "distance_mm": RATIO * RADIUS_MM, "wall": f"at {angle_deg}"}
    return {**where, "angle_from_normal_deg": angle_deg, "outcome": outcome, **more}


def observation(photo, contacts, chains=None, **more):
    """An observation as `vinefab observe` writes it, its contacts on the trunk."""
    first = {"id": "1", "level": 1, "stop_observed": "stuck", "points_mm": [], "contacts": contacts}
    others = [
        {"id": name, "level": 1, "points_mm": chain, "contacts": []}
        for name, chain in (chains or {}).items()
    ]
    return {
        "schema": "vinefab/observation-1",
        "photo": photo,
        "map": "arena.geojson",
        "design": DESIGN,
        "pose": {"x_mm": 200.0, "y_mm": 15.0, "heading_deg": 90.0},
        "branches": others or [first],
        **more,
    }


@pytest.fixture
def written(tmp_path):
    """Write observations as files and return their paths."""

    def write(*observations):
        paths = []
        for number, content in enumerate(observations):
            paths.append(tmp_path / f"observed_{number}.json")
            paths[-1].write_text(json.dumps(content))
        return paths

    return write


# --- the threshold


def test_contacts_that_one_angle_parts_give_an_interval_around_it():
    fit = fit_threshold([1.0, 3.0, 30.0, 50.0], [True, True, False, False], [0, 1, 0, 1], 0.5)
    assert fit.side == "both"
    assert fit.is_separable
    assert (fit.greatest_stopped_deg, fit.least_slid_deg) == (3.0, 30.0)
    assert fit.low_deg <= 3.0 + 0.5
    assert fit.high_deg >= 30.0 - 0.5
    assert 3.0 < fit.value_deg < 30.0


def test_more_contacts_narrow_the_interval_and_more_noise_widens_it():
    rng = np.random.default_rng(4)
    few, many = (
        fit_threshold(*drawn(rng, 8.0, count, photos=6), error_deg=2.0) for count in (12, 240)
    )
    assert many.high_deg - many.low_deg < 0.5 * (few.high_deg - few.low_deg)
    angles = [4.0, 6.0, 9.0, 11.0] * 3
    stopped = [True, True, False, False] * 3
    sharp, blurred = (
        fit_threshold(angles, stopped, [0] * 12, error_deg) for error_deg in (0.5, 5.0)
    )
    assert sharp.high_deg - sharp.low_deg < blurred.high_deg - blurred.low_deg


def test_photos_that_differ_count_for_less_than_as_many_contacts():
    # Two photos, each sure of its own threshold, 4 and 14 degrees.
    angles = [1.0, 2.0, 3.0, 6.0, 7.0, 8.0, 11.0, 12.0, 13.0, 16.0, 17.0, 18.0]
    stopped = [True, True, True, False, False, False] * 2
    alike = fit_threshold(angles, stopped, list(range(12)), 0.5)
    apart = fit_threshold(angles, stopped, [0] * 6 + [1] * 6, 0.5)
    assert apart.photo_spread_deg >= 3.0
    assert apart.high_deg - apart.low_deg > alike.high_deg - alike.low_deg


def _coverage(half_angle_deg, count, photos, campaigns, **spread):
    held = 0
    for number in range(campaigns):
        rng = np.random.default_rng([int(half_angle_deg), count, number])
        seen = drawn(rng, half_angle_deg, count, photos=photos, **spread)
        fit = fit_threshold(*seen, error_deg=2.0)
        held += fit.low_deg <= half_angle_deg <= fit.high_deg
    return held / campaigns


def test_intervals_hold_the_truth_as_often_as_they_say():
    assert _coverage(8.0, 20, 5, 60) >= 0.88


@pytest.mark.thorough
@pytest.mark.parametrize("spread", [{}, {"tip_deg": 1.5}, {"tip_deg": 1.5, "photo_deg": 2.0}])
@pytest.mark.parametrize(("count", "photos"), [(5, 2), (20, 5), (60, 10)])
@pytest.mark.parametrize("half_angle_deg", [1.0, 5.0, 10.0, 15.0])
def test_coverage_over_many_campaigns(half_angle_deg, count, photos, spread):
    share = _coverage(half_angle_deg, count, photos, CAMPAIGNS, **spread)
    print(f"{half_angle_deg:g} deg, {count} contacts, {photos} photos, {spread}: {share:.3f}")  # noqa: T201
    assert share >= 0.90


# --- photos


def _photos(half_angle_deg, photos=6, each=8):
    rng = np.random.default_rng(11)
    angles, stopped, place = drawn(rng, half_angle_deg, photos * each, photos=photos)
    return [
        observation(
            f"photo_{number}.jpg",
            [
                contact(float(a), stopped=bool(s))
                for a, s, p in zip(angles, stopped, place, strict=True)
                if p == number
            ],
            film={"width_mm": {"measured": 13.5, "low": 13.0, "high": 14.0}},
        )
        for number in range(photos)
    ]


def test_photos_give_a_file_that_predictions_read(written, tmp_path):
    fit = fit_files(written(*_photos(9.0)))
    for again in (pickle.loads(pickle.dumps(fit)), copy.deepcopy(fit)):  # noqa: S301  made here
        assert again.json_text() == fit.json_text()
    path = tmp_path / "contacts.toml"
    path.write_text(fit.text())
    found = read_contacts(path)
    assert found == fit.contacts
    half_angle, ratio = found.head_on_half_angle_deg, found.body_width_ratio
    assert half_angle.low <= 9.0 <= half_angle.high
    assert (half_angle.count, half_angle.photos) == (48, 6)
    assert found.tip_friction.value == pytest.approx(
        math.tan(math.radians(half_angle.value)), abs=1e-4
    )
    assert ratio.value == pytest.approx(RATIO, abs=1e-3)
    assert found.film_breadth_ratio.value == pytest.approx(13.5 / (2.0 * RADIUS_MM), abs=1e-3)
    assert found.film_breadth_ratio.low == pytest.approx(13.0 / (2.0 * RADIUS_MM), abs=1e-3)
    words = "\n".join(fit.summary)
    assert "head-on half-angle" in words
    assert f"anchoring keeps its friction of {ASSUMED_FRICTION.value:g}, assumed" in words
    assert tomllib.loads(fit.text())["head_on_half_angle_deg"]["standing"] == "measured"
    options = GrowthOptions.of({"contacts": read_contacts(path)})
    assert options.half_angle_deg == [half_angle.low, half_angle.high]
    assert options.at_one_angle.half_angle_deg == half_angle.value
    assert options.body_width_ratio == ratio.value


@pytest.mark.parametrize(
    ("stopped", "side", "least", "words"),
    [(False, "upper", 12.0, "at most {0.high_deg:g} deg (95 %)"),
     (True, "lower", 20.0, "at least {0.low_deg:g} deg (95 %)")],
)  # fmt: skip
def test_all_alike_are_said_as_a_bound(written, stopped, side, least, words):
    seen = [contact(angle, stopped=stopped) for angle in (12.0, 20.0, 31.0)]
    fit = fit_files(written(observation("a.jpg", seen)), 1.0)
    found, tips = fit.contacts.head_on_half_angle_deg, fit.threshold
    assert (found.side, found.value) == (side, None)
    assert (tips.low_deg, tips.high_deg)[stopped] == (0.0, 90.0)[stopped]
    assert least < (tips.high_deg, tips.low_deg)[stopped] < least + 12.0
    text = "\n".join(fit.summary)
    assert words.format(tips) in text
    assert "bound of the half-angle, no estimate" in text
    assert "value" not in tomllib.loads(fit.text())["head_on_half_angle_deg"]


def test_few_photos_and_what_was_left_out_are_said(written):
    seen = [contact(3.0, stopped=True), contact(30.0, stopped=False)]
    seen.append(contact(10.0, stopped=False, outcome="unclear"))
    one = observation("a.jpg", seen)
    other = observation("b.jpg", [contact(50.0, stopped=True)])
    other["branches"][0]["stop_observed"] = "corner"
    fit = fit_files(written(one, other))
    assert fit.left_out == {"unclear": 1, "stopped for another reason than the angle": 1}
    words = "\n".join(fit.summary)
    assert "1 photo with contacts: too few" in words
    assert "1 unclear, 1 stopped for another reason" in words
    assert "(assumed)" in next(line for line in fit.notes if "standard error" in line)


def test_three_photos_say_too_few_in_the_file_and_wherever_it_is_read(written):
    seen = [contact(3.0, stopped=True), contact(30.0, stopped=False)]
    names = ["a.jpg", "b.jpg", "c.jpg", "d.jpg", "e.jpg"]
    many = [observation(name, seen) for name in names]
    three, five = fit_files(written(*many[:3])), fit_files(written(*many))
    assert "too few photos (3, from 5 on)" in three.text()
    assert "too few photos" in three.contacts.head_on_half_angle_deg.text("deg")
    assert "too few" not in five.text()
    assert "too few" not in five.contacts.head_on_half_angle_deg.text("deg")


def test_nothing_counts_of_a_photo_without_a_verdict_or_of_a_branch_in_doubt(written):
    seen = [contact(3.0, stopped=True), contact(30.0, stopped=False)]
    clear, vague, doubtful = (observation(name, seen) for name in ("a.jpg", "b.jpg", "c.jpg"))
    vague["summary"] = {"fits": False}
    doubtful["branches"][0]["doubts"] = ["its tip is not seen"]
    alone = fit_files(written(clear))
    fit = fit_files(written(clear, vague, doubtful))
    assert fit.threshold == alone.threshold
    assert fit.left_out["unclear"] == 4
    assert any("b.jpg: no verdict" in note for note in fit.notes)


# --- the second way


def _grown_photos(half_angle_deg, tmp_path):
    """Observations of robots that the simulator grew, with tracing noise."""
    world = grid_map(5, GridOptions(size_mm=400.0))
    world.write(tmp_path / "arena.geojson")
    terrain, design = Terrain.of(world), Design.read(DESIGN)
    options = GrowthOptions.of({"head_on_half_angle_deg": half_angle_deg})
    rng = np.random.default_rng(2)
    angles, stopped, place = drawn(rng, half_angle_deg, 24, photos=4)
    start = world.starts[0].pose
    for number in range(4):
        x_mm, turn = start.x_mm + rng.uniform(-10, 10), rng.uniform(-0.25, 0.25)
        pose = Pose(x_mm=x_mm, y_mm=start.y_mm, heading_rad=start.heading_rad + turn)
        grown = grow_on(design, terrain, pose, options)
        chains = {
            name: (
                grown.chain_mm(branch) + rng.normal(0.0, 0.5, grown.chain_mm(branch).shape)
            ).tolist()
            for branch, name in enumerate(grown.tree.ids)
        }
        found = observation(f"photo_{number}.jpg", [], chains)
        found["pose"] = {
            "x_mm": x_mm,
            "y_mm": pose.y_mm,
            "heading_deg": math.degrees(pose.heading_rad),
        }
        pairs = zip(angles, stopped, place, strict=True)
        found["branches"][0]["contacts"] = [
            contact(float(a), stopped=bool(s), distance_mm=RADIUS_MM)
            for a, s, p in pairs
            if p == number
        ]
        yield found


def test_whole_shapes_say_the_same_as_contacts(written, tmp_path):
    fit = fit_files(written(*_grown_photos(8.0, tmp_path)))
    assert fit.shapes.low_deg <= 8.0 <= fit.shapes.high_deg
    assert fit.shapes.error_mm < 2.0
    assert not fit.shapes.says_nothing
    assert fit.threshold.low_deg <= 8.0 <= fit.threshold.high_deg
    assert fit.agreement == "both ways agree"


def test_two_ways_that_contradict_each_other_are_said(written, tmp_path):
    photos = list(_grown_photos(8.0, tmp_path))
    for photo in photos:
        photo["branches"][0]["contacts"] = [
            contact(a, stopped=a < 40.0, distance_mm=RADIUS_MM) for a in (30.0, 38.0, 42.0)
        ]
    fit = fit_files(written(*photos))
    assert fit.agreement == "the intervals do not meet"
    assert "contacts and whole shapes: the intervals do not meet" in fit.summary


# --- what is refused


def test_the_same_observation_twice_is_refused(written):
    one = observation("a.jpg", [contact(3.0, stopped=True)])
    with pytest.raises(BadInputError, match="each observation once"):
        fit_files(written(one, one))


def test_observations_without_anything_to_fit_are_refused(written):
    with pytest.raises(BadInputError, match="no contact slid or stopped"):
        fit_files(written(observation("a.jpg", [])))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": "vinefab/run-1"}, "schema is 'vinefab/run-1'"),
        ({"pose": [1, 2, 3]}, "pose is"),
        ({"branches": [{"id": "1", "level": 0}]}, r"branches\[1\].level is 0"),
        ({"branches": 7}, "branches is 7"),
        (
            {"branches": [{"id": "1", "level": 1, "points_mm": [[1, "x"]]}]},
            r"points_mm\[1\]\[2\] is 'x'",
        ),
    ],
)
def test_a_wrong_observation_is_one_clear_line(written, change, words):
    (path,) = written({**observation("a.jpg", []), **change})
    with pytest.raises(BadInputError, match=words) as raised:
        fit_files([path])
    assert str(path) in str(raised.value)
    assert len(str(raised.value).splitlines()) == 1


def test_what_is_no_json_is_said(tmp_path):
    photo = tmp_path / "photo.jpg"
    photo.write_bytes(b"\xff\xd8\xff")
    with pytest.raises(
        BadInputError, match=r"observations: photo\.jpg is not an observation; give the JSON"
    ):
        fit_files([photo])
    path = photo.rename(tmp_path / "seen.json")
    with pytest.raises(UnreadableFileError):
        fit_files([path])
    path.write_text("[1, 2]")
    with pytest.raises(UnreadableFileError, match="not a JSON object"):
        fit_files([path])
