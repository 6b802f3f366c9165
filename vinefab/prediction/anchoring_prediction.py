"""Anchoring over many deployments: the simulated holding force, and the formula's ideal case."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np

from vinefab.core.plain_text import rounded
from vinefab.core.validation import Floats
from vinefab.core.view import Data, Fact, Number, Rows, Section
from vinefab.model.design import Design
from vinefab.model.laser import Material
from vinefab.physics.anchoring import payload_over_mass
from vinefab.physics.seam import seam_load_n_mm
from vinefab.prediction.family_deployments import FamilyDeployments
from vinefab.prediction.measures import means_by_map
from vinefab.tasks.anchoring_force import IDLE_SHARE, Anchoring


@dataclass(frozen=True, slots=True, kw_only=True)
class OverMaps:
    """A number over maps, each the mean of its deployments; over those where there is one map."""

    median: float
    # low, high: what 90 % of the maps lie between
    low: float
    high: float

    @classmethod
    def of(cls, values: Floats, maps: Sequence[str]) -> "OverMaps":
        """Return the spread of one value per deployment; ``maps`` has the map of each."""
        low, median, high = np.percentile(means_by_map(values, maps), [5.0, 50.0, 95.0]).tolist()
        return cls(median=median, low=low, high=high)

    def text(self) -> str:
        """Return median and range as they are shown."""
        return f"{self.median:.2f} ({self.low:.2f} to {self.high:.2f})"


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldForces:
    """What is held at one coefficient of friction, over that of one pouch without any turn."""

    friction: float  # the coefficient
    engaged: OverMaps  # by the engaged leaves, as far as film and seam stand it; 0 without pouches
    some_idle: OverMaps  # the same with a third of them idle, those that turned most
    ideal: OverMaps  # by every leaf that came out, and nothing fails: the formula
    force_n: OverMaps  # by the engaged leaves, in newtons; 0 without pouches


@dataclass(frozen=True, slots=True, kw_only=True)
class AnchoringPrediction:
    """Anchoring over deployments, for a range of friction."""

    label: str  # of the map family
    leaves: int  # leaves of the design
    has_pouches: bool  # whether it has pouches, which alone hold
    # at the least, the likely and the greatest friction
    held: tuple[HeldForces, HeldForces, HeldForces]
    # engaged_percent, nothing_percent, limited_percent: leaves that are engaged, deployments that
    # hold nothing, deployments in which film or seam limits some branch at the greatest friction
    engaged_percent: float
    nothing_percent: float
    limited_percent: float
    pressure_kpa: float  # working pressure that forces are for
    mass_g: float  # film of the robot; 0 when it is not known

    def over_friction(self, part: str) -> tuple[float, float]:
        """Return the bounds of 90 % of the maps at any of the frictions."""
        every: list[OverMaps] = [getattr(held, part) for held in self.held]
        return min(one.low for one in every), max(one.high for one in every)

    @property
    def likely(self) -> HeldForces:
        """What is held at the friction that is assumed."""
        return self.held[1]


def anchoring_on(material: Material) -> Anchoring:
    """Return the anchoring task with the limits of a film and its seam."""
    return Anchoring(
        film_n_mm=material.strength_mpa.value * material.ply_mm.value,
        seam_n_mm=seam_load_n_mm(material.seam),
    )


def predict_anchoring(
    design: Design, result: FamilyDeployments, task: Anchoring, mass_g: float = 0.0
) -> AnchoringPrediction:
    """Return the expected holding force of a design on one family of maps."""
    frictions = (task.friction_low, task.friction, task.friction_high)
    numbers, engaged, limited, leaves = [], [], [], 0
    has_pouches = design.build.pouch is not None
    for index, deployment in enumerate(result.deployments):
        robot = task.anchored(deployment, design.build, result.prepared_map(index).context)
        numbers.append(
            [
                (has_pouches * robot.amplification(mu)[0],
                 has_pouches * robot.amplification(mu, 1.0 - IDLE_SHARE)[0],
                 robot.ideal(mu)[0], robot.pulls_n(mu)[1][0])
                for mu in frictions
            ]
        )  # fmt: skip
        engaged.append(has_pouches * np.count_nonzero(robot.engaged))
        limited.append(robot.pulls_n(task.friction_high)[2][0] > 0.0)
        leaves = int(deployment.tree.is_leaf.sum())
    parts = ("engaged", "some_idle", "ideal", "force_n")
    low, likely, high = (
        HeldForces(
            friction=mu,
            **{
                part: OverMaps.of(column, result.outcomes.maps)
                for part, column in zip(parts, columns, strict=True)
            },
        )
        for mu, columns in zip(frictions, np.array(numbers).transpose(1, 2, 0), strict=True)
    )
    return AnchoringPrediction(
        label=result.prepared.label,
        leaves=leaves,
        has_pouches=has_pouches,
        held=(low, likely, high),
        engaged_percent=100.0 * float(np.mean(engaged)) / leaves,
        nothing_percent=100.0 * float(np.mean(np.equal(engaged, 0))),
        limited_percent=100.0 * float(np.mean(limited)),
        pressure_kpa=design.build.pressure_kpa,
        mass_g=mass_g,
    )


def anchoring_headline(found: AnchoringPrediction) -> Fact:
    """Return the simulated holding force, next to the ideal case."""
    likely, (least, _, most) = found.likely, found.held
    ideal, over = likely.ideal, f"friction {least.friction:g} to {most.friction:g} (assumed)"
    if not found.has_pouches:
        low, high = found.over_friction("ideal")
        return Fact(
            name="anchoring amplification, ideal case",
            value=f"{ideal.median:.1f} x",
            detail=f"the design has no pouches: were every leaf that came out to hold like one, "
            f"median over {found.label} at friction {likely.friction:g}; 90 % of the maps "
            f"{low:.1f} to {high:.1f} over {over}",
            tone="caution",
        )
    held, force_n = likely.engaged, likely.force_n
    (low, high), (low_n, high_n) = map(found.over_friction, ("engaged", "force_n"))
    return Fact(
        name="anchoring amplification",
        value=f"{held.median:.1f} x",
        detail=f"{force_n.median:.2f} N at {found.pressure_kpa:g} kPa: median over {found.label} "
        f"at friction {likely.friction:g}; 90 % of the maps {low:.1f} to {high:.1f} x, "
        f"{low_n:.2f} to {high_n:.2f} N over {over}; "
        f"{found.engaged_percent:.0f} % of the leaves jam, {found.nothing_percent:.0f} % of the "
        f"deployments hold nothing (simulated). Ideal case, every leaf that came out jams: "
        f"{ideal.median:.1f} x",
        tone="plain" if held.median >= 1.0 else "caution",
    )


ANCHORING_NOTE = (
    "Force at the base over that of one pouch without any turn: the sum of e^(mu gamma) over the "
    "leaves that hold, gamma the turns at contacts on the way (equations 1 and 2 of the paper); "
    "joints and hinges at bases, where no wall need be touched, wrap nothing. A leaf holds where "
    "it grew in full, so that its pouch is out, and its inflated pouch is wider than the gap that "
    "it ended in; no branch, the trunk included, holds more than film and seam are known to stand. "
    "Of six branches in the paper's test one touched nothing and one hung slack: a third of the "
    "engaged leaves may be idle. The friction of film on the obstacles is assumed; measure yours."
)


def anchoring_blocks(anchoring: Sequence[AnchoringPrediction]) -> Iterator[Data | Section]:
    """Yield anchoring by friction: engaged leaves, some of them idle, and the ideal case."""
    percents = ("engaged_percent", "nothing_percent", "limited_percent")
    yield Data(
        {
            "anchoring": [
                {
                    "label": found.label,
                    "leaves": found.leaves,
                    "has_pouches": found.has_pouches,
                    "over_friction": {
                        part: rounded(found.over_friction(part), 2)
                        for part in ("engaged", "ideal", "force_n")
                    },
                    "pressure_kpa": found.pressure_kpa,
                    "held": [
                        rounded(asdict(held), 2) | {"friction": held.friction}
                        for held in found.held
                    ],
                    **{name: round(getattr(found, name), 1) for name in percents},
                }
                for found in anchoring
            ]
        }
    )
    number = partial(Number, form=".2f")
    engaged = [
        f"{found.engaged_percent:.1f} % of the leaves are engaged; {found.nothing_percent:.1f} % "
        "of the deployments hold nothing"
        if found.has_pouches
        else "Without pouches none is engaged: ideal case only"
        for found in anchoring
    ]
    tables = [
        Rows(
            caption=f"Amplification on {found.label}, {found.leaves} leaves: median over maps "
            f"(90 % of the maps). {words} (simulated paths, assumed friction)",
            headings=("what holds", *(f"friction {held.friction:g}" for held in found.held)),
            rows=(
                *(
                    (
                        ("leaves that are engaged", *(h.engaged.text() for h in found.held)),
                        ("a third of them idle", *(h.some_idle.text() for h in found.held)),
                    )
                    if found.has_pouches
                    else ()
                ),
                ("ideal case: every leaf that came out",
                 *(held.ideal.text() for held in found.held)),
            ),
        )
        for found, words in zip(anchoring, engaged, strict=True)
    ]  # fmt: skip
    tables += [
        Rows(
            caption=f"Force on {found.label} at {found.pressure_kpa:g} kPa: only leaves that are "
            f"engaged hold; film or seam limits some branch in {found.limited_percent:.1f} % of "
            "the deployments at the highest friction (simulated paths, computed contact, assumed "
            "friction)",
            headings=("friction", "median N", "5 % N", "95 % N", "times its own mass"),
            rows=tuple(
                (f"{held.friction:g}", number(n.median), number(n.low), number(n.high),
                 f"{payload_over_mass(n.median, found.mass_g):.0f}" if found.mass_g else "-")
                for held in found.held for n in (held.force_n,)
            ),
        )
        for found in anchoring
        if found.has_pouches
    ]  # fmt: skip
    without = () if anchoring[0].has_pouches else (
        "The design has no pouches, so that every leaf that came out counts and forces in newtons "
        "are not predicted: only the ideal case is.",
    )  # fmt: skip
    yield Section(
        title="Anchoring",
        paragraphs=(ANCHORING_NOTE, *without),
        tables=tuple(tables),
        folded=True,
    )
