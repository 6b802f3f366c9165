"""Robots aimed on a map: how poses are searched, and each robot with its best pose."""

import math
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated

import numpy as np

from vinefab.core.codec import Record, decimals
from vinefab.core.limits import MOST_SEED, deg
from vinefab.core.plain_text import counted
from vinefab.core.statistics import PAIRED_TAILS, mean_interval
from vinefab.core.validation import Floats, number, whole
from vinefab.core.view import Number, Value
from vinefab.growth.options import GrowthOptions
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose
from vinefab.model.target import TargetsResult
from vinefab.prediction.pose_search import (
    MOST_PLACING_DEG,
    MOST_PLACING_MM,
    PLACING_DEG,
    PLACING_MM,
    PoseErrors,
    PoseSearch,
    pose_of,
)
from vinefab.prediction.robot_set import GREEDY_SHARE, LARGEST_TEAM, RobotSet, union_curve
from vinefab.tasks.task import Task

FEWEST_DEPLOYMENTS, MOST_DEPLOYMENTS = 5_000, 10_000_000

WORST_SHARE = 0.1

DEPLOYMENTS_PER_CANDIDATE, MOST_TEAM_CANDIDATES = 100, 3_000
"""Several robots are chosen from one pose for so many deployments of the search."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AimPlan:
    """How poses are searched."""

    where: str = "border"  # where a base may stand, see `BaseRegion.of`
    deployments: int = 100_000  # of each design's search, about
    placing_mm: float = PLACING_MM  # a base is placed within so far
    placing_deg: float = PLACING_DEG  # and turned within so much
    robots: int = 1  # how many are to cover most together
    seed: int = 0  # seed of the fresh draws
    # the growth model's choices; half-angles are drawn from their range
    options: GrowthOptions = field(default_factory=GrowthOptions)

    def __post_init__(self) -> None:
        whole("--deployments", self.deployments, FEWEST_DEPLOYMENTS, MOST_DEPLOYMENTS)
        whole("--robots", self.robots, 1, LARGEST_TEAM)
        whole("--seed", self.seed, 0, MOST_SEED)
        number("--placing-mm", self.placing_mm, 0.0, MOST_PLACING_MM, "mm")
        number("--placing-deg", self.placing_deg, 0.0, MOST_PLACING_DEG, "deg")

    @property
    def errors(self) -> PoseErrors:
        """What differs from deployment to deployment."""
        return PoseErrors(
            placing_mm=self.placing_mm,
            placing_deg=self.placing_deg,
            half_angle_range_rad=self.options.half_angle_range_rad,
        )

    @property
    def candidates(self) -> int:
        """About how many poses several robots are chosen from."""
        return min(MOST_TEAM_CANDIDATES, self.deployments // DEPLOYMENTS_PER_CANDIDATE)

    @property
    def placing_text(self) -> str:
        """The placing errors, as text."""
        return f"placed within {self.placing_mm:g} mm and {self.placing_deg:g} deg (assumed)"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoseEstimate:
    """What a pose scores at fresh draws, the same for all poses."""

    pose: Pose
    scores: Floats  # one per draw

    @property
    def mean(self) -> float:
        """Expected score."""
        return float(self.scores.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the expected score."""
        return mean_interval(self.scores)

    @property
    def over(self) -> str:
        """How many independent samples the interval is over."""
        return counted(len(self.scores), "draw")

    @property
    def worst_tenth(self) -> float:
        """Mean of the worst tenth of the scores."""
        count = max(1, math.ceil(WORST_SHARE * len(self.scores)))
        return float(np.sort(self.scores)[:count].mean())

    @property
    def numbers(self) -> "PoseScore":
        """The estimate as JSON has it."""
        low, high = self.interval
        return PoseScore(
            pose=TypedPose.of(self.pose),
            mean=self.mean,
            low=low,
            high=high,
            worst_tenth=self.worst_tenth,
            deployments=len(self.scores),
        )

    def above(self, other: "PoseEstimate") -> "ScoreGain":
        """Return the mean gain over another pose with its 95 % interval, paired draw by draw."""
        differences = self.scores - other.scores
        low, high = mean_interval(differences, tails=PAIRED_TAILS)
        return ScoreGain(mean=float(differences.mean()), low=low, high=high)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnedScores:
    """Scores over the heading at one place, at the draws of the search."""

    headings_rad: Floats  # shape (h,)
    scores: Floats  # shape (h, k)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AimedRobot:
    """One design's search on a map."""

    name: str
    design: Design
    search: PoseSearch
    best: PoseEstimate
    start: PoseEstimate | None  # at the map's own start, if it has one
    turned: TurnedScores  # at the best place
    shown: tuple[Deployment, ...]  # from the best pose, at some fresh draws
    team: RobotSet | None  # where several robots are asked for
    targets: TargetsResult | None = None  # that it touches at fresh draws; None without targets
    notes: tuple[str, ...] = ()  # what a user should know, a sentence each

    @property
    def cells(self) -> tuple[Value, ...]:
        """The design as a row: best pose, score, worst tenth, search, start."""
        best, start = self.best, self.start
        score = partial(Number, form=".4f", decimals=5)
        from_start = "-" if start is None else f"{start.mean:.4f} from {start.pose.text}"
        return (
            self.name,
            best.pose.text,
            score(best.mean, interval=best.interval, over=best.over),
            score(best.worst_tenth),
            score(self.search.estimate),
            from_start,
        )

    @property
    def gain(self) -> "ScoreGain | None":
        """Mean gain over the map's own start."""
        return None if self.start is None else self.best.above(self.start)

    def numbers(self, first: "AimedRobot") -> "RobotNumbers":
        """Return the robot as JSON has it, next to the one that was asked about."""
        landscape, turned = self.search.landscape, self.turned
        return RobotNumbers(
            design=self.name,
            branches=self.design.branch_count,
            length_mm=self.design.tree.total_length_mm,
            deployments=self.search.deployments,
            best=self.best.numbers,
            search_mean=self.search.estimate,
            search_draws=self.search.draws,
            start=None if self.start is None else self.start.numbers,
            gain_over_start=self.gain,
            first_minus_this=None if self is first else first.best.above(self.best),
            landscape=LandscapeNumbers(
                draws=landscape.draws,
                spacing_mm=landscape.spacing_mm,
                heading_deg=[deg(value) for value in landscape.headings_rad],
                places_mm=landscape.places_mm.tolist(),
                mean=landscape.scores.tolist(),
            ),
            headings_at_best=HeadingNumbers(
                heading_deg=[deg(value) for value in turned.headings_rad],
                mean=turned.scores.mean(axis=1).tolist(),
            ),
            together=None if self.team is None else TeamNumbers.of(self.team),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Aims:
    """Robots aimed on one map: the one that was asked about, and those that it is held against."""

    world: Map
    task: Task
    plan: AimPlan
    robots: tuple[AimedRobot, ...]


# --- As JSON --------------------------------------------------------------------------------------

FiveDecimals = Annotated[float, decimals(5)]
Headings = Annotated[list[float], decimals(2)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TypedPose(Record):
    """A pose with its words as they are typed."""

    x_mm: float
    y_mm: float
    heading_deg: Annotated[float, decimals(2)]
    text: str

    @classmethod
    def of(cls, pose: Pose) -> "TypedPose":
        """Return a pose."""
        return cls(text=pose.text, **pose.content)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreGain:
    """A mean difference of scores with its 95 % interval."""

    mean: FiveDecimals
    low: FiveDecimals
    high: FiveDecimals


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseScore(ScoreGain):
    """The expected score of a pose with its 95 % interval."""

    pose: TypedPose
    worst_tenth: FiveDecimals
    deployments: int


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingNumbers:
    """Mean scores over headings."""

    heading_deg: Headings
    mean: Annotated[list[float], decimals(5)]


@dataclass(frozen=True, slots=True, kw_only=True)
class LandscapeNumbers:
    """Mean scores all over a region: a row over the headings for each place."""

    draws: int
    spacing_mm: Annotated[float, decimals(3)]
    heading_deg: Headings
    places_mm: Annotated[list[list[float]], decimals(2)]
    mean: Annotated[list[list[float]], decimals(5)]


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamShare:
    """The share that the first so many robots of a team cover."""

    count: int
    share: FiveDecimals  # mean of fresh draws
    low: FiveDecimals
    high: FiveDecimals
    search_bound: FiveDecimals  # no set of as many candidates covers more
    search_share: FiveDecimals


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastShare:
    """Shares of the best set's cover that the chosen one has at least."""

    always: Annotated[float, decimals(4)]
    here: FiveDecimals


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamNumbers:
    """Several robots that together cover most."""

    covered: str  # what they cover
    candidates: int
    poses: tuple[TypedPose, ...]
    robots: tuple[TeamShare, ...]
    least_share_of_best: LeastShare

    @classmethod
    def of(cls, team: RobotSet) -> "TeamNumbers":
        """Return a set of robots."""
        return cls(
            covered=team.cover.words,
            candidates=team.candidates,
            poses=tuple(TypedPose.of(pose_of(row)) for row in team.poses),
            robots=tuple(
                TeamShare(
                    count=count,
                    share=mean,
                    low=low,
                    high=high,
                    search_bound=bound,
                    search_share=share,
                )
                for (count, mean, low, high, bound), share in zip(
                    union_curve(team), team.choice.covered, strict=True
                )
            ),
            least_share_of_best=LeastShare(always=GREEDY_SHARE, here=team.least_share),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotNumbers(Record):
    """An aimed robot."""

    design: str
    branches: int
    length_mm: Annotated[float, decimals(3)]
    deployments: int  # of its whole search
    best: PoseScore
    search_mean: FiveDecimals  # that the search chose it by
    search_draws: int
    start: PoseScore | None
    gain_over_start: ScoreGain | None
    first_minus_this: ScoreGain | None  # None of the first robot
    landscape: LandscapeNumbers
    headings_at_best: HeadingNumbers
    together: TeamNumbers | None
