"""Contract tests of parts, for the tests of a package that offers some.

Each function takes a part, uses it as vinefab does, and raises `AssertionError` with one sentence
where it breaks its contract. A part that raises ends in `vinefab.core.errors.BrokenPluginError`.
"""

import json
import pickle
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from vinefab.fabrication.formats.laser_drawing import LaserFileSpec, LaserFormat, file_problems
from vinefab.fabrication.rules.rule import Rule, Subject
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.environments import Environment
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.design import Design
from vinefab.model.files.shipped import DEFAULT_RECIPE, names
from vinefab.model.laser import LaserProfile, read_profile
from vinefab.model.map import Map, map_text
from vinefab.search.optimizers.optimizer import OptimizerConfig, SearchAxes, started
from vinefab.search.record.result import state_from_text, state_to_text
from vinefab.tasks.evaluate import PreparedMap, poses_on
from vinefab.tasks.task import Task, ensure_task, evaluated, outcomes

_DESIGNS = ("plain_vine", "three_level_tree")


def check_task(task: Task) -> None:
    """Check a task: finite and repeatable scores, none below ``lowest``, the same terms always.

    What it evaluates for a block of growths must be the same as one by one, and it must be
    possible to send it to another process.

    Raises
    ------
    AssertionError
        If it breaks its contract.
    BrokenPluginError
        If it breaks down, writes into what it is given, or returns something else.
    """
    ensure_task(task)
    again = pickle.loads(pickle.dumps(task))  # noqa: S301  made here
    prepared = PreparedMap.of(grid_map(1, GridOptions()))
    names = None
    for name in _DESIGNS:
        for block in _blocks(Design.read(name), prepared):
            together = outcomes(task, block, [prepared.context])
            for index in range(len(block)):
                deployment = block.deployment(index)
                score, terms = evaluated(task, deployment, prepared.context)
                other = evaluated(again, deployment, prepared.context)
                _ensure(score >= task.lowest, f"score {score:g} is below lowest, {task.lowest:g}")
                _ensure((score, terms) == other, "a second evaluation gives another result")
                _ensure(names in (None, list(terms)), f"terms are {list(terms)}, before {names}")
                names = list(terms)
                one = together.one(index)[0]
                _ensure(abs(one - score) <= 1e-9 * max(1.0, abs(score)), _BLOCK)


_BLOCK = "evaluate_block gives other scores than evaluate"


def _blocks(design: Design, prepared: PreparedMap) -> Iterator[Any]:
    poses = poses_on([prepared], 3, [1])
    terrains, options = TerrainSet([prepared.terrain]), GrowthOptions()
    batch = Batch(Plans.of([design], options), Launches.of(terrains, poses), options)
    yield from batch.each(lambda block: block)


def check_environment(environment: Environment) -> None:
    """Check an environment: maps with a start, the same for the same seed, kept by their file."""
    options = environment.options()
    for seed in (0, 1):
        world = environment.generate(seed, options)
        _ensure(bool(world.starts), f"the map of seed {seed} has no start")
        text = map_text(world)
        same = map_text(environment.generate(seed, options)) == text
        _ensure(same, f"seed {seed} gives two different maps")
        PreparedMap.of(world)
    _ensure(isinstance(world, Map), "it makes no map")


def check_optimizer(config: OptimizerConfig, generations: int = 4) -> None:
    """Check an optimizer: points in the unit cube, and a restored one continues bit for bit.

    Raises
    ------
    AssertionError
        If it breaks its contract.
    """
    axes = SearchAxes(choices=(3, 0, 0, 0), levels=(0, 0, 0, 3), depth=0)
    one = started(config, type(config).__name__, axes, 12, 1)
    for number in range(generations):
        x = np.array(one.ask())
        _ensure(x.ndim == 2 and x.shape[1] == len(axes) and len(x) > 0, f"points of {x.shape}")
        _ensure(bool(((x >= 0.0) & (x <= 1.0)).all()), "points outside the unit cube")
        _ensure(np.array_equal(x, one.ask()), "asking again before telling gives other points")
        one.tell(x, -((x - 0.3) ** 2).sum(axis=1))
        other = started(config, type(config).__name__, axes, 12, 1)
        other.restore(state_from_text(state_to_text(one.state())))
        same = np.array_equal(other.ask(), one.ask())
        _ensure(same, f"restored after generation {number + 1} it asks for other points")
    json.loads(state_to_text(one.state()))


def check_rule(rule: Rule, violating: Mapping[str, Design] | None = None) -> None:
    """Check a rule: the same outcome each time, and findings on branches that there are.

    Parameters
    ----------
    violating
        Designs that must break it, by name.
    """
    profile = read_profile(DEFAULT_RECIPE)
    designs = {name: Design.read(name) for name in _DESIGNS}
    for name, design in {**designs, **(violating or {})}.items():
        for subject in (Subject.of(design), Subject.of(design, profile)):
            outcome = rule.apply(subject, rule.limits_with({}))
            again = rule.apply(subject, rule.limits_with({}))
            _ensure(outcome == again, f"on {name} a second check gives another outcome")
            found = getattr(outcome, "violations", ())
            unknown = {one for each in found for one in each.branches} - set(subject.names)
            _ensure(not unknown, f"on {name} it names branches that there are not: {unknown}")
        _ensure(bool(found) or name not in (violating or {}), f"it finds nothing in {name}")


def check_laser_format(laser_format: LaserFormat) -> None:
    """Check a laser format: its files hold all paths of a job, as their reader reads them."""
    profile = _profile_for(laser_format)
    for name in _DESIGNS:
        job = Subject.of(Design.read(name), profile).job
        if job is not None:
            spec = LaserFileSpec(job=job, profile=profile)
            if laser_format.where_needed and not laser_format.paths(spec):
                continue
            problems = file_problems(laser_format, laser_format.write(spec).encode(), spec)
            _ensure(not problems, f"{name}: {'; '.join(problems)}")


def _profile_for(laser_format: LaserFormat) -> LaserProfile:
    """Return the first shipped recipe whose tools a format is for, with beds that hold anything."""
    tools = laser_format.tools
    known = (read_profile(name) for name in (DEFAULT_RECIPE, *names("recipe")))
    found = next(one for one in known if not tools or not tools.isdisjoint(one.tools))
    side = found.machine.bed_width_mm.changed(value=2000.0)
    return replace(found, machine=found.machine.changed(bed_width_mm=side, bed_height_mm=side))


def _ensure(condition: bool, problem: str) -> None:  # noqa: FBT001
    if not condition:
        raise AssertionError(problem)
