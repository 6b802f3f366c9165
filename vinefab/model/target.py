"""Targets: places on a map that a robot is to touch, and whether it does."""

import math
import string
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, product
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
import shapely
from annotated_types import Ge, Le, Unit
from pydantic import Field, PlainSerializer, PlainValidator, model_validator
from shapely.geometry.base import BaseGeometry
from typing_extensions import Doc

from vinefab.core.errors import BadInputError, UnfitInputError, inside
from vinefab.core.plain_text import counted
from vinefab.core.table import Table, validated
from vinefab.core.validation import LARGEST_MM, Floats, Ints
from vinefab.core.view import Answer, Block, Data, Number, Result, Rows, Tone

if TYPE_CHECKING:
    from vinefab.model.deployment import Deployment
    from vinefab.model.map import Map

Coordinate = Annotated[float, Ge(-LARGEST_MM), Le(LARGEST_MM)]
Point = Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]

TOLERANCE_MM = 20.0
"""Of a point, where it has none (assumed)."""

MOST_TARGETS = 1000
_MOST_LETTERS = 40


class Target(Table):
    """A point or an area of a map that a robot is to touch."""

    name: Annotated[str, Doc("in results; default: A, B, C ...")] = ""
    point_mm: Annotated[Point | None, Unit("mm"), Doc("[x, y] of a point")] = None
    area_mm: Annotated[
        tuple[Point, ...] | None, Field(strict=False), Unit("mm"), Doc("corners of an area")
    ] = None
    tolerance_mm: Annotated[
        float,
        Ge(0),
        Le(LARGEST_MM),
        Unit("mm"),
        Doc(
            "largest straight distance of a centreline, walls or not, that counts as touched; "
            "default: 20 for a point, 0 for an area (assumed)"
        ),
    ] = TOLERANCE_MM

    @model_validator(mode="before")
    @classmethod
    def _tolerance_of_area(cls, given: Any) -> Any:  # noqa: ANN401  what pydantic hands on
        if isinstance(given, Mapping) and given.get("area_mm") is not None:
            return {"tolerance_mm": 0.0, **given}
        return given

    @model_validator(mode="after")
    def _one_place(self) -> "Target":
        if (self.point_mm is None) == (self.area_mm is None):
            raise UnfitInputError(
                "", "a target needs a point_mm or an area_mm, one of them", "give one"
            )
        if len(self.name) > _MOST_LETTERS or not self.name.isprintable():
            allowed = f"at most {_MOST_LETTERS} printable characters"
            raise BadInputError("name", self.name, allowed)
        if self.area_mm is not None:
            corners = len(set(self.area_mm))
            if corners < 3 or not shapely.Polygon(self.area_mm).is_valid:
                problem = f"its {counted(corners, 'corner')} enclose no area"
                raise UnfitInputError("area_mm", problem, "give 3 or more whose sides do not cross")
        return self

    @property
    def shape(self) -> shapely.Point | shapely.Polygon:
        """The point or the polygon, mm."""
        return shapely.Point(self.point_mm) if self.point_mm else shapely.Polygon(self.area_mm)

    @property
    def middle_mm(self) -> tuple[float, float]:
        """The point, or one inside the area."""
        if self.point_mm is not None:
            return self.point_mm
        inside = self.shape.representative_point()
        return inside.x, inside.y

    @property
    def place_text(self) -> str:
        """Where it is, for messages."""
        x_mm, y_mm = self.middle_mm
        around = "" if self.point_mm else "around "
        return f"{around}({x_mm:g}, {y_mm:g}) mm"


def targets_given(given: object, key: str = "") -> tuple[Target, ...]:
    """Return targets with names: of targets, tables, or bare points [x, y].

    Parameters
    ----------
    key
        What messages call them; empty in a table, which puts its own before it.

    Raises
    ------
    BadInputError
        If one is not a target, or two have one name.

    Examples
    --------
    >>> [one.name for one in targets_given([(130, 330), {"name": "A", "point_mm": [5, 5]}])]
    ['B', 'A']
    """
    allowed = f'[[x, y], {{ name = "B", point_mm = [x, y] }}, ...], at most {MOST_TARGETS}'
    if not isinstance(given, list | tuple) or len(given) > MOST_TARGETS:
        value = f"{len(given)} targets" if isinstance(given, list | tuple) else given
        raise BadInputError(key, value, allowed) if key else ValueError(allowed)
    found = [_target(one, f"{key}[{place}]") for place, one in enumerate(given, start=1)]
    taken = Counter(one.name for one in found if one.name)
    for place, one in enumerate(found, start=1):
        if taken[one.name] > 1:
            problem = f"another target is called {one.name!r}"
            raise UnfitInputError(f"{key}[{place}].name", problem, "give each its own name")
    letters = (product(string.ascii_uppercase, repeat=length) for length in count(1))
    free = (name for some in letters for name in map("".join, some) if name not in taken)
    return tuple(one if one.name else one.changed(name=next(free)) for one in found)


def _target(given: object, key: str) -> Target:
    if isinstance(given, Target):
        return given
    content: object = given
    if isinstance(given, list | tuple | np.ndarray):
        content = {"point_mm": tuple(given)}
    if not isinstance(content, Mapping):
        raise BadInputError(key, given, '[x, y] in mm, or { name = "B", point_mm = [x, y] }')
    with inside(key):
        return validated(Target, content)


def target_from(text: str, key: str = "target") -> Target:
    """Return the target that words say: ``[NAME=]X,Y[+-TOLERANCE]``, mm.

    >>> target_from("shelf=130,330+-15").tolerance_mm
    15.0
    """
    named, _, place = text.rpartition("=")
    spot, sign, tolerance = place.partition("+-")
    try:
        x_mm, y_mm = map(float, spot.split(","))
        within = {"tolerance_mm": float(tolerance)} if sign else {}
        return Target(name=named.strip(), point_mm=(x_mm, y_mm), **within)
    except BadInputError as error:
        raise error.under(f"{key} {text}: {error.key}") from None
    except ValueError:
        allowed = "[NAME=]X,Y or [NAME=]X,Y+-TOLERANCE, in mm"
        raise BadInputError(key, text, allowed) from None


def target_text(target: Target) -> str:
    """Return a point as `target_from` reads it.

    >>> target_text(Target(name="shelf", point_mm=(130, 330), tolerance_mm=15))
    'shelf=130,330+-15'
    """
    x_mm, y_mm = target.middle_mm
    named = f"{target.name}=" if target.name else ""
    within = "" if target.tolerance_mm == TOLERANCE_MM else f"+-{target.tolerance_mm:g}"
    return f"{named}{x_mm:g},{y_mm:g}{within}"


def check_targets(world: "Map", targets: Sequence[Target], key: str = "targets[{}]") -> None:
    """Raise `BadInputError` where a target has nothing in the free space of a map.

    Parameters
    ----------
    key
        What messages call one: ``{}`` stands for its number, from 1.
    """
    for place, target in enumerate(targets, start=1):
        shape = target.shape
        solid = "outside the bounds"
        if world.bounds.intersects(shape):
            solid = "inside an obstacle"
            near = [one for one in world.obstacles if one.intersects(shape)]
            if shape.area > 0.0:
                left = shapely.intersection(shape, world.bounds).difference(shapely.union_all(near))
                is_free = left.area > 0.0
            else:
                is_free = not any(one.contains(shape) for one in near)
            if is_free:
                continue
        named = f"{target.name} at {target.place_text}" if target.name else target.place_text
        problem = f"{named} is {solid} of map {world.name!r}"
        raise UnfitInputError(key.format(place), problem, "move it into free space")


def out_of_reach(
    targets: Sequence[Target], starts: Sequence[BaseGeometry], longest_mm: float
) -> Iterator[tuple[int, str, str]]:
    """Yield the places, from 1, of targets too far for a robot from any start, how far, and why.

    Parameters
    ----------
    starts
        Where bases may stand, mm.
    longest_mm
        Greatest length of a robot from its base to a tip.
    """
    for place, target in enumerate(targets, start=1):
        far_mm = min((shapely.distance(start, target.shape) for start in starts), default=0.0)
        if far_mm > longest_mm + target.tolerance_mm:
            within = f" with {target.tolerance_mm:g} mm of tolerance" if target.tolerance_mm else ""
            most = f"{longest_mm:.0f} mm, the robot's greatest length,{within}".rstrip(",")
            yield place, f"{target.name}, {far_mm:.0f} mm from the start", most


# --- Results -------------------------------------------------------------------------------------


class Branches(NamedTuple):
    """Branches as ranges of chain points, n of them; those that never emerged have none."""

    points_mm: Floats  # shape (p, 2)
    # index of each branch's first point, and of the one after its last, shape (n,)
    first: Ints
    end: Ints

    def gaps_mm(self, targets: Sequence[Target], *, tips: bool = False) -> tuple[Ints, Floats]:
        """Return the branch of each straight stretch, or tip, and how far targets are from it.

        Returns
        -------
        tuple
            Shape (s,), rising, and (s, t).
        """
        if tips:
            owner = np.flatnonzero(self.end > self.first)
            a = b = self.end[owner] - 1
        else:
            count = np.maximum(self.end - self.first - 1, 0)
            owner = np.repeat(np.arange(len(count)), count)
            before = np.cumsum(count) - count
            a = np.repeat(self.first - before, count) + np.arange(count.sum())
            b = a + 1
        base, along = self.points_mm[a], self.points_mm[b] - self.points_mm[a]
        squared = np.maximum((along**2).sum(axis=1), np.finfo(np.float64).tiny)
        gaps_mm = np.empty((len(owner), len(targets)))
        for column, target in enumerate(targets):
            if target.point_mm is None:
                lines = shapely.linestrings(np.stack([base, base + along], axis=1))
                gaps_mm[:, column] = shapely.distance(lines, target.shape)
            else:
                point = np.array(target.point_mm)
                share = np.clip(((point - base) * along).sum(axis=1) / squared, 0.0, 1.0)
                gaps_mm[:, column] = np.hypot(*(point - base - share[:, None] * along).T)
        return owner, gaps_mm


def _far_mm(given: Sequence[float | None]) -> Floats:
    return np.array([math.inf if far is None else far for far in given], dtype=np.float64)


def _known_mm(away_mm: Floats) -> list[float | None]:
    return [far if math.isfinite(far) else None for far in away_mm.tolist()]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetOutcome:
    """How near robots come to one target (simulated)."""

    target: Target
    # nearest distance in each deployment, shape (n,); infinite, null in JSON: nothing came out
    away_mm: Annotated[Floats, PlainValidator(_far_mm), PlainSerializer(_known_mm)]
    branches: tuple[str, ...]  # id of the nearest branch in each deployment; empty: none came out

    @property
    def touched(self) -> Floats:
        """Whether each deployment touches it, shape (n,), 0 or 1."""
        return (self.away_mm <= self.target.tolerance_mm).astype(np.float64)

    @property
    def share(self) -> float:
        """Share of the deployments that touch it."""
        return float(self.touched.mean())

    @property
    def missed_mm(self) -> float:
        """By how much it is missed: 0 where at least half of the deployments touch it.

        The median over the deployments, of two in the middle the smaller one.
        """
        missed = np.maximum(0.0, self.away_mm - self.target.tolerance_mm)
        return float(np.sort(missed)[(len(missed) - 1) // 2])

    @property
    def is_touched(self) -> bool:
        """Whether at least half of the deployments touch it."""
        return self.missed_mm == 0.0

    @property
    def branch(self) -> str:
        """The branch that touches it most often, or comes nearest most often; empty: none."""
        touching = [b for b, is_in in zip(self.branches, self.touched, strict=True) if is_in]
        named = Counter(touching or [branch for branch in self.branches if branch])
        return named.most_common(1)[0][0] if named else ""

    @property
    def state(self) -> str:
        """``touched``, or by how much it is missed."""
        if self.is_touched:
            return "touched"
        # Rounded up: what is missed is never 0 mm.
        far = f" by {np.ceil(self.missed_mm):.0f} mm" if np.isfinite(self.missed_mm) else ""
        return f"missed{far}"


_MOST_NAMED = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class TargetsResult(Result):
    """Which targets a robot touches, and by how much it misses the others (simulated).

    Parameters
    ----------
    outcomes
        One for each target.
    together
        Share of the deployments that touch all of their targets.
    deployments
        How many there were.
    """

    outcomes: tuple[TargetOutcome, ...]
    together: float
    deployments: int
    schema = "vinefab/targets-1"

    @classmethod
    def of(cls, outcomes: Sequence[TargetOutcome], together: Floats) -> "TargetsResult":
        """Return the result of deployments, of which some touch all of their targets."""
        share, deployments = float(together.mean()), len(together)
        return cls(outcomes=tuple(outcomes), together=share, deployments=deployments)

    @classmethod
    def touched(
        cls, deployments: "Iterable[tuple[Deployment, Sequence[Target]]]", *, tips: bool = False
    ) -> "TargetsResult | None":
        """Return the targets that deployments touch; None where none has any.

        Targets of one name count as one.

        Parameters
        ----------
        deployments
            Each with the targets of its map.
        tips
            Whether only tips touch, instead of every point of a centreline.
        """
        found: dict[str, list[tuple[Target, float, str]]] = {}
        together: list[float] = []
        for deployment, targets in deployments:
            if not targets:
                continue
            first = deployment.first_point
            branches = Branches(deployment.points_mm, first[:-1], first[1:])
            owner, gaps_mm = branches.gaps_mm(targets, tips=tips)
            names = [deployment.tree.ids[branch] for branch in owner.tolist()]
            nearest = gaps_mm.argmin(axis=0).tolist() if names else []
            touched = []
            for place, target in enumerate(targets):
                far_mm = float(gaps_mm[nearest[place], place]) if names else np.inf
                name = names[nearest[place]] if names else ""
                found.setdefault(target.name, []).append((target, far_mm, name))
                touched.append(far_mm <= target.tolerance_mm)
            together.append(float(all(touched)))
        outcomes = [
            TargetOutcome(
                target=rows[0][0],
                away_mm=np.array([far_mm for _, far_mm, _ in rows]),
                branches=tuple(name for *_, name in rows),
            )
            for rows in found.values()
        ]
        return cls.of(outcomes, np.array(together)) if outcomes else None

    @property
    def missed(self) -> tuple[TargetOutcome, ...]:
        """The targets that are missed, the nearest first."""
        missed = (one for one in self.outcomes if not one.is_touched)
        return tuple(sorted(missed, key=lambda one: one.missed_mm))

    @property
    def all_touched(self) -> bool:
        """Whether each target is touched in at least half of the deployments."""
        return not self.missed

    @property
    def tone(self) -> Tone:
        """Good where all are touched together in at least half of the deployments."""
        if self.all_touched and self.together >= 0.5:
            return "good"
        return "caution" if len(self.missed) < len(self.outcomes) else "bad"

    @property
    def headline(self) -> str:
        """The result in one clause: ``2 of 3 touched, B missed by 25 mm``."""
        total, missed = len(self.outcomes), self.missed
        words = [f"{total - len(missed)} of {total} touched"]
        if missed and not np.isfinite(missed[0].missed_mm):
            words.append("no branch comes out")
        else:
            words += [f"{one.target.name} {one.state}" for one in missed[:_MOST_NAMED]]
            words += [f"{len(rest)} more"] if (rest := missed[_MOST_NAMED:]) else []
        text = ", ".join(words)
        if self.deployments == 1:
            return text
        every, many = "all" if total > 1 else "touched", counted(self.deployments, "deployment")
        return f"{text}; {every} in {100 * self.together:.0f} % of {many}"

    def view(self) -> Iterator[Block]:
        """Yield the headline, and each target with its state, branch and share."""
        yield self.answer()
        yield from self.below

    def answer(self, score: str = "") -> Answer:
        """Return the headline as the result in one sentence, with the score."""
        return Answer(f"{self.headline}{f'; {score}' if score else ''} (simulated)", self.tone)

    @property
    def below(self) -> tuple[Block, ...]:
        """The table, and the headline as it stands in JSON."""
        return self.table, Data({"targets_headline": self.headline})

    @property
    def table(self) -> Rows:
        """Each target with its state, branch and share."""
        several = self.deployments > 1
        share = (f"touched in, of {counted(self.deployments, 'deployment')}",) * several
        half = ": the median deployment" if several else ""
        return Rows(
            caption=f"targets{half} (simulated; tolerances assumed)",
            headings=("target", "X,Y", "within", "state", "by branch", *share),
            rows=tuple(
                (one.target.name, f"{one.target.middle_mm[0]:g},{one.target.middle_mm[1]:g}",
                 Number(one.target.tolerance_mm, "mm", "g"), one.state, one.branch or "-",
                 *((Number(one.share, "%", ".0f", per=0.01),) * several))
                for one in self.outcomes
            ),
            key="targets",
            keys=("", "", "", "", "", *(("",) * several)),
            data=self.content,
        )  # fmt: skip

    @property
    def content(self) -> list[dict[str, Any]]:
        """The targets as plain values: in JSON, records and the studio."""
        return [
            {
                **one.target.content,
                "touched": one.is_touched,
                "missed_mm": one.missed_mm if np.isfinite(one.missed_mm) else None,
                "branch": one.branch or None,
                "share": one.share,
                "deployments": len(one.away_mm),
            }
            for one in self.outcomes
        ]
