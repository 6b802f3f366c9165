"""What a run's winner is expected to do elsewhere (simulated): the prediction that is recorded."""

from dataclasses import dataclass, replace
from typing import Annotated, Any

from pydantic import Field

from vinefab.core.codec import IF_KNOWN, MaybeNan, Record
from vinefab.core.plain_text import counted, rounded
from vinefab.core.statistics import MeanValue
from vinefab.core.view import Fact, Number, Rows
from vinefab.growth.options import BranchContact, UnknownRule
from vinefab.model.quantity import Standing
from vinefab.model.score import Failures

KnownBy = Annotated[str, Field(exclude_if="assumed".__eq__)]
"""Where a number comes from; JSON says nothing where it is assumed."""

PLACED_OFF = 10.0
"""A body is placed this well [assumed]: mm to either side, and degrees of its heading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FamilyScores:
    """A winner's scores on one family of maps."""

    label: str  # of the family
    maps: int
    deployments: int
    score: MeanValue
    scores: tuple[float, ...]  # of each deployment
    failed: Failures
    over_contacts: tuple[MeanValue, ...]  # at each head-on half-angle

    @property
    def contact_ends(self) -> tuple[float, float]:
        """The least and the greatest mean score over contacts."""
        means = [value.mean for value in self.over_contacts]
        return min(means), max(means)


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleScores:
    """A winner's mean scores under each choice of a rule of growth that is not known."""

    option: UnknownRule  # name of the growth option
    choices: tuple[BranchContact | float, ...]
    standing: str  # ``assumed``, or ``measured`` and how
    # unseen, training: one for each choice
    unseen: tuple[MeanValue, ...]
    training: tuple[MeanValue, ...]

    def __post_init__(self) -> None:
        _ensure_alike(self.choices, self.unseen, self.training)

    @property
    def words(self) -> tuple[str, str]:
        """What facts and tables call it."""
        if self.option == "branch_contact":
            return "where branches meet", "at the body of another branch a tip passes or stops"
        return "over emergence", "a child comes out with a probability of"

    @property
    def choice_words(self) -> tuple[str, ...]:
        """Its choices as they are shown."""
        return tuple(one if isinstance(one, str) else f"{one:.3g}" for one in self.choices)


_WHERE = {"pass": "if tips pass", "stop": "if tips stop"}
"""Choices of `growth.branch_contact` as words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedOff:
    """How the mean score changes where the body is placed elsewhere than meant."""

    knob: str  # ``heading`` or ``position``
    step: float
    unit: str
    deployments: int  # from places with room for the trunk
    # NaN without any
    change: MaybeNan
    low: MaybeNan
    high: MaybeNan
    over: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureRoom(Record):
    """The room between the pressure of growth and the limit of the widest part."""

    is_open: bool
    needed_kpa: float
    allowed_kpa: float
    working_kpa: float  # the design's working pressure
    safety_factor: float  # burst over allowed pressure
    standing: Standing  # of burst pressures


@dataclass(frozen=True, slots=True, kw_only=True)
class WinnerPressure(PressureRoom):
    """The pressures at which a winner deploys."""

    holds_working: bool  # whether the working pressure is among them
    words: str  # whether it is deployable, after "manufacturable"

    @property
    def fact(self) -> Fact:
        """The pressures, where there are any."""
        room = f"{self.needed_kpa:g} to {self.allowed_kpa:g} kPa"
        outside = "" if self.holds_working else ", outside this window"
        return Fact(
            "pressure window",
            room if self.is_open else f"none: {self.words}",
            detail=f"works at {self.working_kpa:g} kPa{outside}",
            tone="plain" if self.holds_working else "caution",
            standing=f"simulated, {self.standing}",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class WinnerPieces:
    """In how many flat pieces a winner is cut (computed)."""

    count: int | None  # None: it cannot be
    proven_least: bool

    @property
    def words(self) -> str:
        """The number, and whether fewer are possible."""
        if self.count is None:
            return "cannot be cut in flat pieces"
        least = "no fewer possible" if self.proven_least else "fewer may be possible"
        return f"{counted(self.count, 'piece')}, {least}"


@dataclass(frozen=True, slots=True, kw_only=True)
class WinnerPrediction(Record):
    """What a run's winner is expected to do elsewhere."""

    task: str  # its name
    title: str  # the same, and whether it is only the ideal case
    head_on_half_angles_deg: tuple[float, ...]  # that it was tried with
    head_on_half_angles_standing: KnownBy = "assumed"  # or ``measured`` and how
    trained_half_angle_deg: float | list[float]  # or its range
    unseen: FamilyScores  # on unseen maps, or from other poses
    training: FamilyScores  # on the training maps
    rules: tuple[RuleScores, ...]
    placed_off: tuple[PlacedOff, ...]  # on unseen maps
    note: str  # why there are no unseen maps; empty where there are
    pressure_window: Annotated[WinnerPressure | None, IF_KNOWN] = None  # None where it is not known
    pieces: Annotated[WinnerPieces | None, IF_KNOWN] = None  # None where it must be one

    def __post_init__(self) -> None:
        angles = self.head_on_half_angles_deg
        _ensure_alike(angles, self.unseen.over_contacts, self.training.over_contacts)

    @property
    def families(self) -> tuple[FamilyScores, FamilyScores]:
        """The scores on unseen and on training maps."""
        return self.unseen, self.training

    @property
    def placed_off_ends(self) -> tuple[float, float]:
        """The least and the greatest mean score of a body placed off by up to `PLACED_OFF`."""
        near = [one for one in self.placed_off if one.deployments and abs(one.step) <= PLACED_OFF]
        score, changes = self.unseen.score.mean, [0.0, *(one.change for one in near)]
        return score + min(changes), score + max(changes)

    @property
    def origin(self) -> dict[str, Any]:
        """The part that stands in the winner's design file."""
        unseen = self.unseen
        score, count = unseen.score, None if self.pieces is None else self.pieces.count
        interval = {"unseen_score_interval": rounded([score.low, score.high], 4)}
        deployments = counted(unseen.deployments, "deployment")
        return {
            "unseen": f"{unseen.label}, {deployments} (simulated)",
            "unseen_score": round(score.mean, 4),
            **(interval if score.has_interval else {}),
            "unseen_half_angles_deg": [*self.head_on_half_angles_deg],
            "unseen_score_over_contacts": [round(one.mean, 4) for one in unseen.over_contacts],
            "unseen_score_placed_off": rounded([*self.placed_off_ends], 4),
            **({"pieces": count} if count else {}),
        }

    # --- As it is shown ---------------------------------------------------------------------------

    @property
    def width_facts(self) -> tuple[Fact, ...]:
        """How wide the score is over contacts, and under each choice of a rule."""
        angles_deg, (least, most) = self.head_on_half_angles_deg, self.unseen.contact_ends
        over_contacts = Fact(
            f"{self.title} over contacts",
            f"{least:.3f} to {most:.3f}",
            detail=f"mean at head-on half-angles of {angles_deg[0]:g} to {angles_deg[-1]:g} deg",
            standing=f"simulated, {_short(self.head_on_half_angles_standing)}",
        )
        rules = (
            Fact(
                f"{self.title} {rule.words[0]}",
                ", ".join(
                    f"{value.mean:.3f} {_WHERE.get(choice, f'at {choice}')}"
                    for choice, value in zip(rule.choice_words, rule.unseen, strict=True)
                ),
                detail=f"means over the same poses (growth.{rule.option})",
                standing=f"simulated, {_short(rule.standing)}",
            )
            for rule in self.rules
        )
        return over_contacts, *rules

    @property
    def lead_facts(self) -> tuple[Fact, ...]:
        """The facts that lead a page: the score elsewhere, failures, and placed off."""
        low, high = self.placed_off_ends
        angles_deg, (least, most) = self.head_on_half_angles_deg, self.unseen.contact_ends
        middle = len(angles_deg) // 2
        number = mean_number(self.unseen.over_contacts[middle])
        over = f"mean over {counted(self.unseen.deployments, 'deployment')}"
        score = Fact(
            f"{self.title} on {self.unseen.label}",
            replace(number, interval=None),
            detail=f"{number.bracket}, {over} at a half-angle of {angles_deg[middle]:g} deg; "
            f"{least:.3f} to {most:.3f} over {angles_deg[0]:g} to {angles_deg[-1]:g} deg; "
            f"{self.unseen.score.mean:.3f} as trained".removeprefix(", "),
            standing=f"simulated, {_short(self.head_on_half_angles_standing)}",
        )
        placed = Fact(
            f"{self.title} placed off",
            f"{low:.3f} to {high:.3f}",
            detail=f"mean with the body up to {PLACED_OFF:g} mm or {PLACED_OFF:g} deg off",
            standing="simulated, assumed",
        )
        return score, self.unseen.failed.fact, placed

    @property
    def tables(self) -> tuple[Rows, ...]:
        """The mean scores over contacts and under each choice of a rule, on both families."""
        title, words = f"mean {self.title} score", "with 95 % intervals over maps, from the same"
        over_contacts = Rows(
            caption=f"{title} over the head-on half-angle ({self.head_on_half_angles_standing}), "
            f"{words} poses (simulated)",
            headings=("where", *(f"{angle:g} deg" for angle in self.head_on_half_angles_deg)),
            rows=tuple(
                (family.label, *map(mean_number, family.over_contacts)) for family in self.families
            ),
            folded=True,
        )
        rules = (
            Rows(
                caption=f"{title} where {rule.words[1]} ({_short(rule.standing)}), {words} poses "
                "(simulated)",
                headings=("where", *rule.choice_words),
                rows=tuple(
                    (family.label, *map(mean_number, values))
                    for family, values in zip(
                        self.families, (rule.unseen, rule.training), strict=True
                    )
                ),
                folded=True,
            )
            for rule in self.rules
        )
        return over_contacts, *rules


def _ensure_alike(choices: tuple[Any, ...], *values: tuple[MeanValue, ...]) -> None:
    """Raise `ValueError` unless there is a mean for each of some choices, at least one."""
    if not choices or any(len(one) != len(choices) for one in values):
        raise ValueError(f"{len(choices)} choices, but {[len(one) for one in values]} means")


def _short(standing: str) -> str:
    return standing.partition(":")[0]


def mean_number(value: MeanValue) -> Number:
    """Return a mean score with its 95 % interval, where it has one."""
    interval = (value.low, value.high) if value.has_interval else None
    return Number(value.mean, form=".3f", interval=interval, over=value.over)
