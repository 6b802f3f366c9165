"""Nouns and results survive pickling, deep copies and another process.

So they can be sent to a pool of processes, and kept on disk with joblib.
"""

import copy
import inspect
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from functools import cache

import pytest
from shapely import box

import vinefab as vf
from tests.cli.test_calibration import filled
from vinefab.core import errors
from vinefab.core.view import Result
from vinefab.growth import kernel
from vinefab.outline.body_outline import body_outline

ROOM = vf.Map(
    name="room",
    bounds=box(0.0, 0.0, 400.0, 400.0),
    obstacles=(box(150.0, 150.0, 200.0, 200.0),),
    starts=(vf.Start(pose=vf.Pose(x_mm=200.0, y_mm=10.0, heading_rad=1.5)),),
    facts={"read": {"lines": 4}},
)
DESIGN = vf.Design.read("three_level_tree").changed(
    limits={"VF-C01": {"warning": 3.0}},
    origin={"made": {"by": ["hand"]}},
)
SETTINGS = vf.RunSettings(
    maps=vf.MapSettings(count=1, options={"columns": 3, "rows": 3}),
    optimizer=vf.PartSettings(name="random"),
    search=vf.SearchSettings(population=4, generations=1),
    evaluation=vf.EvaluationSettings(fabricable=False, finalists=1, finalists_by="training"),
)


PLAIN = vf.Design.read("plain_vine")


def filled_table(folder):
    """Return the table of coupons that were measured."""
    vf.coupon(out=folder, progress=False)
    filled(folder)
    return folder / "results.csv"


VERBS = {
    "aim": lambda _: vf.aim(PLAIN, ROOM, deployments=5000, progress=False),
    "calibrate": lambda out: vf.calibrate(filled_table(out / "cut"), out=out / "mine.toml"),
    "check": lambda _: vf.check(DESIGN),
    "compare": lambda _: vf.compare((PLAIN, DESIGN), maps=ROOM, progress=False),
    "coupon": lambda out: vf.coupon(out=out / "coupon"),
    "designs": lambda _: vf.designs(),
    "examples": lambda out: vf.examples(out=out / "examples"),
    "fabricate": lambda out: vf.fabricate(PLAIN, out=out / "robot", allow_uncalibrated=True),
    "fix": lambda _: vf.fix(PLAIN, progress=False),
    "grow": lambda _: vf.grow(DESIGN, ROOM),
    "inflate": lambda _: vf.inflate(PLAIN, progress=False),
    "maps.info": lambda _: vf.maps.info(ROOM),
    "new": lambda out: vf.new("design", out / "design.toml"),
    "optimize": lambda _: vf.optimize(SETTINGS, progress=False),
    "printers": lambda _: vf.printers(),
    "profile": lambda _: vf.profile("co2_40w__stretchlon_200"),
    "profiles": lambda _: vf.profiles(),
    "recipes": lambda _: vf.recipes(),
    "report": lambda out: vf.report(PLAIN, maps=ROOM, out=out / "page.html", progress=False),
    "rules": lambda _: vf.rules(),
    "runs": lambda out: vf.runs(written_run(out)),
    "score": lambda _: vf.score(DESIGN, maps=ROOM),
}
"""Verbs with a small question each."""

LONG = {"bench", "benchmark", "contest", "demo", "fit_observations", "observe", "reproduce"}
"""Verbs that take minutes, all with a `StudyOutcome`, or photos, whose own tests copy results."""

CLASSES = {name: one for name in dir(vf) if inspect.isclass(one := getattr(vf, name))}


@cache
def nouns(folder):
    """Return a noun of every public class that no verb returns, by its name."""
    grown = vf.grow(DESIGN, ROOM)
    score = vf.score(DESIGN, maps=ROOM)
    report = vf.check(DESIGN, limits={"VF-C01": {"warning": 90.0}})
    waived = report.findings[0]
    found = [DESIGN, ROOM, SETTINGS, SETTINGS.maps, SETTINGS.search, SETTINGS.evaluation]
    found += [SETTINGS.optimizer, ROOM.starts[0], ROOM.starts[0].pose, DESIGN.build]
    found += [DESIGN.levels[0], grown.deployment, vf.Stop.HEAD_ON, score.evaluations[0]]
    found += [
        waived,
        waived.severity,
        vf.rules("VF-C01")["VF-C01"],
        body_outline(DESIGN).contour,
    ]
    found += [vf.Pouch(shape="round", radius_mm=9.0), vf.Collar(clamp_diameter_mm=20.0)]
    found += [vf.Branch(name="left", length_mm=50.0)]
    found += [vf.runs(written_run(folder)), vf.BadInputError("key", 2, "less", "file.toml")]
    found += [vf.StudyOutcome(found=score, blocks=tuple(score.view()), text=score.json_text())]
    found += [vf.ExportRefusedError("robot", "it is too wide", summary=("a line",))]
    return {type(one).__name__: one for one in found}


def written_run(folder):
    """Return the folder of a run."""
    vf.optimize(SETTINGS, out=folder / "run", page=False, progress=False)
    return folder / "run"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    return tmp_path_factory.mktemp("pickles")


@pytest.fixture(scope="module")
def pool():
    """One process that shares nothing with this one."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as executor:
        yield executor


def ensure_equal(again, noun):
    """Compare a noun with its copy: its whole content in plain values."""
    assert type(again) is type(noun)
    if isinstance(noun, Result):
        assert again.json_text() == noun.json_text()
    elif isinstance(noun, Exception):
        assert (str(again), again.__dict__) == (str(noun), noun.__dict__)
    elif isinstance(noun, vf.Map | vf.Deployment | vf.Contour):
        assert repr(again) == repr(noun)
        assert pickle.dumps(again) == pickle.dumps(pickled(noun))
    else:
        assert again == noun


def pickled(noun):
    return pickle.loads(pickle.dumps(noun))  # noqa: S301  made here


def ensure_copied(noun, pool):
    ensure_equal(pickled(noun), noun)
    ensure_equal(copy.deepcopy(noun), noun)
    ensure_equal(pool.submit(copy.copy, noun).result(), noun)


@pytest.mark.parametrize("verb", VERBS)
def test_the_result_of_every_verb_is_copied_and_sent(verb, place, pool):
    ensure_copied(VERBS[verb](place), pool)


def test_every_public_class_is_copied_and_sent(place, pool):
    made = nouns(place)
    for noun in made.values():
        ensure_copied(noun, pool)
    returned = {"AimResult", "DesignComparison", "InflatedDesign", "ProposedFix", "RunResult"}
    returned |= {"DeployedDesign", "MapInfo", "ProfileNumbers", "Score", "CheckReport", "Names"}
    returned |= {"WrittenFile", "WrittenFolder"}
    missing = CLASSES.keys() - made.keys() - returned
    assert missing == {"VinefabError", "WrittenResult"}


def grown_with_a_copy(found):
    """Grow something of this process's own, then what was sent to it."""
    vf.score(DESIGN, maps=ROOM)
    return found.json_text(), len(kernel.grow_jobs.signatures)


def test_a_copy_grows_without_compiling_again(pool):
    """Arrays forget that they are read-only, which is another type to the compiler, for 10 s."""
    found = VERBS["compare"](None)
    for again in (pickled(found), copy.deepcopy(found)):
        assert pool.submit(grown_with_a_copy, again).result() == (found.json_text(), 1)


def test_every_verb_is_asked_here():
    verbs = {name for name in dir(vf) if inspect.isfunction(getattr(vf, name))}
    assert verbs - LONG == VERBS.keys() - {"maps.info"}


@pytest.mark.parametrize(
    "kind",
    [one for one in vars(errors).values() if inspect.isclass(one)],
    ids=lambda kind: kind.__name__,
)
def test_every_error_is_copied_and_sent(kind, pool):
    if not issubclass(kind, vf.VinefabError) or kind is vf.VinefabError:
        return
    needed = [
        one
        for one in inspect.signature(kind).parameters.values()
        if one.default is one.empty and one.kind is one.POSITIONAL_OR_KEYWORD
    ]
    ensure_copied(kind(*[["a"] if one.name == "known" else "a" for one in needed]), pool)


def test_a_frozen_noun_stays_frozen_in_its_copy():
    again = copy.deepcopy(DESIGN)
    with pytest.raises(TypeError):
        again.origin["task"] = "reach"
    with pytest.raises(TypeError):
        again.limits["VF-C01"]["warning"] = 0.0
    assert again.origin == {"made": {"by": ["hand"]}}
