"""A frozen benchmark: problems whose maps, budget and test never change, for any way to design.

Every problem fixes the run (space, build, growth, seeds of its maps), its budget and the unseen
maps that winners are scored on. A digest of all of them guards each: a version of vinefab that
would pose another problem refuses it. Results are one file; files of different people are ranked
together.
"""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from vinefab.core.codec import Record
from vinefab.core.errors import (
    BadInputError,
    UnfitInputError,
    UnknownNameError,
    UnreadableFileError,
)
from vinefab.core.hashing import fingerprint
from vinefab.core.plain_text import counted, json_text
from vinefab.core.progress import each
from vinefab.core.validation import Floats
from vinefab.core.view import Block, Notes, Number, Result, Rows, Value, p_value
from vinefab.growth.options import BRANCH_CONTACTS, BranchContact, GrowthOptions
from vinefab.model.design import Design
from vinefab.model.files.run_context import map_fingerprint, package_versions
from vinefab.model.files.shipped import read_text
from vinefab.search.manufacturability import (
    ManufacturabilityPenalty,
    run_profile,
    with_build_for_film,
)
from vinefab.search.run import generated_maps
from vinefab.search.settings import MapSettings, RunSettings, has_own_targets, plain_settings
from vinefab.studies.optimizer_contest import (
    Contender,
    Contest,
    ContestRow,
    SeedDifference,
    SeedMean,
    unseen_score,
    unseen_sites,
)

VERSION = 1
"""Of the problems; a problem that changes gets another."""

POPULATION, GENERATIONS, MAPS = 60, 167, 5
GROWTHS = POPULATION * GENERATIONS * MAPS
"""Budget of a search: designs times training maps, those included that a penalty screens out."""

UNSEEN = 100

BENCHMARK_FILE = "benchmark.json"

SCHEMA = f"vinefab/benchmark-{VERSION}"

_TARGETS = {
    "maps": {
        "environment": "grid",
        "count": 1,
        "seed": 3,
        "start": {
            "x_mm": 250, "y_mm": 15, "heading_deg": 90, "spread_x_mm": 10,
            "spread_heading_deg": 10,
        },
    },
    "task": {
        "name": "reach",
        "parameters": {"targets": [[130, 330], [250, 380], [390, 260]]},
    },
}  # fmt: skip
"""Three points of a known Grid, touched from any start of a range; every seed has its own Grid."""

DIGESTS: Mapping[str, str] = {
    "grid-coverage-levels-pass": "b278afa449e5",
    "grid-coverage-levels-stop": "7273d1861b51",
    "grid-coverage-free-pass": "5f9db33fa3d9",
    "grid-coverage-free-stop": "8f86a77b0f5e",
    "grid-reach-levels-pass": "489229bf0283",
    "grid-reach-levels-stop": "26a14e1639c8",
    "grid-reach-free-pass": "2543a265c6da",
    "grid-reach-free-stop": "a0b0e0415b12",
    "cave-coverage-levels-pass": "2c7beb179d31",
    "cave-coverage-levels-stop": "1b4d2af39465",
    "cave-coverage-free-pass": "382740681f2c",
    "cave-coverage-free-stop": "17c5c480572d",
    "cave-reach-levels-pass": "774eb58fef39",
    "cave-reach-levels-stop": "0cb408eeea61",
    "cave-reach-free-pass": "aef47121abbf",
    "cave-reach-free-stop": "6188b122b5fa",
    "targets-levels-pass": "018e0586e4ef",
    "targets-levels-stop": "5a0195621f17",
    "targets-free-pass": "8c44fd714c99",
    "targets-free-stop": "d9e1a17dbafe",
}
"""Of every problem of this version: its settings, its first training maps, all its unseen maps."""


def _subjects() -> Iterator[tuple[str, dict[str, object]]]:
    """Yield the subjects of problems: maps and task."""
    for environment, task in product(("grid", "cave"), ("coverage", "reach")):
        tables = {"maps": {"environment": environment, "count": MAPS}, "task": {"name": task}}
        yield f"{environment}-{task}", tables
    yield "targets", _TARGETS


@cache
def frozen_problems() -> Mapping[str, RunSettings]:
    """Return the settings of every problem by its name."""
    found = {}
    for (subject, tables), tree, bodies in product(
        _subjects(), ("levels", "free"), BRANCH_CONTACTS
    ):
        name = f"{subject}-{tree}-{bodies}"
        found[name] = _posed(name, tables, tree, bodies)
    return found


def _posed(
    name: str, tables: Mapping[str, object], tree: str, bodies: BranchContact
) -> RunSettings:
    """Return robots of bench size that are cut as one flat outline, compensated for inflation."""
    growth = GrowthOptions(
        head_on_half_angle_rad=math.radians(1.0),
        body="inflated",
        pressure_stop=False,
        branch_contact=bodies,
    )
    return with_build_for_film(
        RunSettings(
            name=name,
            space={
                "tree": tree,
                "levels": [2, 4],
                "length_mm": [40.0, 205.0],
                "angle_deg": [30.0, 160.0],
                "branches": [2, 4],
                "growth_percent": [50.0, 160.0],
            },
            build={"trunk_width_mm": 24.0, "width_ratio": 0.65},
            growth=growth,
            search={"population": POPULATION, "generations": GENERATIONS},
            evaluation={"fabricable": True},
            **tables,
        )
    )


@cache
def digest_of(name: str) -> str:
    """Return the digest of a problem: its settings, its first maps, and those of the test."""
    settings = frozen_problems()[name]
    plain, maps = _given(plain_settings(settings.changed(name=""))), settings.maps
    test = () if has_own_targets(settings) else unseen_sites(maps, UNSEEN)
    prints = [
        *_first_prints(maps.environment, maps.seed, maps.count),
        *(map_fingerprint(site.world) for site in test),
    ]
    return fingerprint(VERSION, GROWTHS, UNSEEN, plain, prints)


def _given(plain: object) -> object:
    """Return plain settings without those that are off: what later versions add changes nothing."""
    if isinstance(plain, dict):
        found = {key: _given(value) for key, value in plain.items()}
        return {key: value for key, value in found.items() if value not in (None, "", [], {})}
    return [_given(value) for value in plain] if isinstance(plain, list) else plain


@lru_cache
def _first_prints(environment: str, seed: int, count: int) -> tuple[str, ...]:
    made = generated_maps(MapSettings(environment=environment, seed=seed, count=count))
    return tuple(map(map_fingerprint, made))


def posed(names: Sequence[str]) -> dict[str, RunSettings]:
    """Return problems by name, all where none is named.

    Raises
    ------
    UnfitInputError
        If this version of vinefab would pose another problem than the one of that name.
    UnknownNameError
        If there is no such problem.
    """
    known = frozen_problems()
    for name in names:
        if name not in known:
            raise UnknownNameError("problem", name, known)
    chosen = {name: known[name] for name in names or known}
    for name in each("problems", tuple(chosen)):
        if digest_of(name) != DIGESTS[name]:
            problem = (
                f"this vinefab makes another problem of it ({digest_of(name)}, not {DIGESTS[name]})"
            )
            raise UnfitInputError(name, problem, "compare with the version that made the results")
    return chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkRow(Record):
    """One winner of a search, or one design that was given, on the unseen maps of a problem."""

    # problem, contender, number: what it is of whom, and which of its seeds or designs
    problem: str
    contender: str
    number: int
    score: float  # mean composite on the unseen maps (simulated)
    can_be_made: bool  # whether it passes the full check
    searched: bool  # by a search of the problem; otherwise a design that was given

    @classmethod
    def of_run(cls, row: ContestRow) -> "BenchmarkRow":
        """Return a search's row."""
        return cls(
            problem=row.problem,
            contender=row.contender,
            number=row.number,
            score=row.unseen,
            can_be_made=row.penalty == 0.0,
            searched=True,
        )


def benchmark_contest(
    problems: Mapping[str, RunSettings], contenders: Sequence[Contender], seeds: int
) -> Contest:
    """Return the searches of contenders: every number has the same maps and seed for all."""
    return Contest(
        problems=tuple(problems.values()),
        contenders=tuple(contenders),
        seeds=seeds,
        unseen=UNSEEN,
        poses=1,
    )


def rows_of_designs(
    designs: Sequence[Design], problems: Mapping[str, RunSettings]
) -> list[BenchmarkRow]:
    """Return the scores of designs that somebody brings, however they were found."""
    found, names = [], [design.name for design in designs]
    pairs = tuple(product(problems.items(), enumerate(designs)))
    for (name, settings), (number, design) in each("designs", pairs):
        penalty = ManufacturabilityPenalty(profile=run_profile(settings.evaluation))
        found.append(
            BenchmarkRow(
                problem=name,
                contender=design.name,
                number=names[:number].count(design.name),
                score=unseen_score(design, settings, UNSEEN, 1),
                can_be_made=penalty.passes(design),
                searched=False,
            )
        )
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkResults(Result):
    """Rows of one or several benchmark files, ranked."""

    rows: tuple[BenchmarkRow, ...]
    schema: ClassVar[str] = SCHEMA

    @classmethod
    def read(cls, path: Path) -> "BenchmarkResults":
        """Return the rows of a file.

        Raises
        ------
        UnreadableFileError
            If it is not a result of this version of the benchmark.
        """
        text = read_text(path)
        try:
            content: dict[str, Any] = json.loads(text)
            if content["schema"] != SCHEMA:
                raise UnreadableFileError(path, f"is {content['schema']!r}; readable: {SCHEMA}")
            rows = tuple(BenchmarkRow.of_json(json.dumps(row)) for row in content["rows"])
            named = {row.problem: content["problems"][row.problem] for row in rows}
        except (ValueError, KeyError, TypeError):
            raise UnreadableFileError(
                path, f"is not a result of the benchmark ({SCHEMA})"
            ) from None
        for name, digest in named.items():
            if DIGESTS.get(name) != digest:
                raise UnreadableFileError(path, f"has another problem {name} ({digest})")
        return cls(rows=rows)

    @property
    def names(self) -> tuple[str, ...]:
        """Its problems, in the order of the benchmark."""
        found = {row.problem for row in self.rows}
        return tuple(name for name in DIGESTS if name in found)

    def json_text(self) -> str:
        """Return everything as JSON; the same on every computer."""
        content = {
            "growths": GROWTHS,
            "unseen_maps": UNSEEN,
            "problems": {name: DIGESTS[name] for name in self.names},
            "ranking": [one.content for name in self.names for one in self.ranking(name)],
            "rows": [row.content for row in self.rows],
            "versions": package_versions(),
        }
        return json_text(SCHEMA, content)

    def ranking(self, problem: str) -> list["BenchmarkPlace"]:
        """Return the contenders of a problem, the best mean score first."""
        by_name: dict[str, list[BenchmarkRow]] = {}
        for row in self.rows:
            if row.problem == problem:
                by_name.setdefault(row.contender, []).append(row)
        means = {
            name: math.fsum(r.score for r in rows) / len(rows) for name, rows in by_name.items()
        }
        order = sorted(by_name, key=lambda name: (-means[name], name))
        best = by_name[order[0]]
        return [
            BenchmarkPlace.of(problem, name, by_name[name], best, len(order) - 1) for name in order
        ]

    def view(self) -> Iterator[Block]:
        """Yield a table with every problem's contenders, the best first."""
        yield Rows(
            caption=f"mean score on {UNSEEN} unseen maps (simulated) [95 % interval by t]; "
            "difference to the best, paired by seed, adjusted for the number of contenders",
            headings=("problem", "contender", "score", "to the best", "p", "can be made"),
            rows=tuple(one.cells for name in self.names for one in self.ranking(name)),
        )
        if any(not row.searched for row in self.rows):
            yield Notes(("designs that were given are not paired: no seed belongs to them",))


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkPlace(Record):
    """A contender of a problem among others."""

    # problem, contender, count: what it is of whom, and of how many searches or designs
    problem: str
    contender: str
    count: int
    score: SeedMean
    can_be_made: float  # share
    to_best: SeedDifference | None  # None of the best, and where there are no pairs

    @classmethod
    def of(
        cls,
        problem: str,
        contender: str,
        rows: Sequence[BenchmarkRow],
        best: Sequence[BenchmarkRow],
        others: int,
    ) -> "BenchmarkPlace":
        """Return the place of some rows against the best contender's."""
        mine, theirs = _by_seed(rows), _by_seed(best)
        paired = sorted(set(mine) & set(theirs))
        is_best = rows is best
        return cls(
            problem=problem,
            contender=contender,
            count=len(rows),
            score=SeedMean.of(np.array([row.score for row in rows])),
            can_be_made=float(np.mean([row.can_be_made for row in rows])),
            to_best=None
            if is_best or not paired
            else SeedDifference.between(_at(mine, paired), _at(theirs, paired), max(others, 1)),
        )

    @property
    def cells(self) -> tuple[Value, ...]:
        """The place as a row."""
        over = counted(self.count, "run")
        score = Number(
            self.score.mean, form=".4f", interval=(self.score.low, self.score.high), over=over
        )
        more: tuple[Value, Value] = ("", "")
        if (gap := self.to_best) is not None:
            more = (
                Number(gap.mean, form="+.4f", interval=(gap.low, gap.high)),
                p_value(gap.p_adjusted),
            )
        return (
            self.problem,
            self.contender,
            score,
            *more,
            Number(100 * self.can_be_made, "%", ".0f"),
        )


def _by_seed(rows: Sequence[BenchmarkRow]) -> dict[int, float]:
    return {row.number: row.score for row in rows if row.searched}


def _at(scores: Mapping[int, float], seeds: Sequence[int]) -> Floats:
    return np.array([scores[seed] for seed in seeds])


def together(paths: Sequence[Path]) -> BenchmarkResults:
    """Return the results of several files.

    Raises
    ------
    BadInputError
        If two files have a row of the same contender and seed with different numbers.
    """
    rows: dict[tuple[str, str, int], BenchmarkRow] = {}
    for path in paths:
        for row in BenchmarkResults.read(path).rows:
            key = row.problem, row.contender, row.number
            if rows.setdefault(key, row) != row:
                who = f"{row.contender} of {row.problem}, seed {row.number}"
                raise BadInputError(str(path), who, "the number that another file has for it")
    return BenchmarkResults(rows=tuple(rows.values()))


def problems_table() -> Rows:
    """Return every problem with its digest."""
    return Rows(
        caption=f"problems of {SCHEMA}: {GROWTHS:,} growths a search, {UNSEEN} unseen maps",
        headings=("problem", "digest"),
        rows=tuple(DIGESTS.items()),
    )
