"""Predictions for a design over maps and unseen environments, on top of how it is made."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.core.units import deg
from vinefab.fabrication.package.bom import bill_of_materials
from vinefab.fabrication.package.package_page import assumption_section, pressure_section
from vinefab.fabrication.package.prepare import Prepared, design_facts, making_sections, prepare
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Design
from vinefab.model.laser import LaserProfile
from vinefab.pages.html import Report, Section, page_html
from vinefab.prediction.anchoring_prediction import AnchoringPrediction, predict_anchoring
from vinefab.prediction.assumptions import model_assumptions
from vinefab.prediction.deployments import (
    FamilyDeployments,
    PredictionPlan,
    PreparedFamily,
    Tell,
    deploy_family,
    silent,
    typical,
)
from vinefab.prediction.heat_map import HeatMap, heat_map_of
from vinefab.prediction.map_families import MapFamily
from vinefab.prediction.measures import SEEN, Measure, Spread
from vinefab.prediction.pressure_window import PressureWindow, burst_basis, window_of
from vinefab.prediction.provenance import Origin, repeat_section
from vinefab.prediction.sections import (
    anchoring_section,
    deployment_section,
    heat_section,
    sensitivity_section,
    spread_section,
    tolerance_section,
    window_section,
)
from vinefab.prediction.sensitivity import (
    QUICK,
    Effect,
    Tolerance,
    VariantBench,
    sensitivity,
    tolerance,
)
from vinefab.prediction.verdict import cautions, headlines, verdict_on

MOST_PICTURES = 6

_SHARES = (
    (0.0, "the deployment that sees least"),
    (0.5, "the median deployment"),
    (1.0, "the deployment that sees most"),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Predicted:
    """What a design is expected to do, and how it is made."""

    prepared: Prepared  # job and check
    trips: tuple[FamilyDeployments, ...]  # deployments in each field, the maps given first
    trials: PredictionPlan  # how it was deployed
    window: PressureWindow | None  # the pressure window; None where nothing ever emerged
    holdings: tuple[AnchoringPrediction, ...]  # anchoring in each field
    heat: HeatMap  # where it goes on the first map
    # effects, tolerance: sensitivity, and scatter from making
    effects: tuple[Effect, ...]
    tolerance: Tolerance

    @property
    def main(self) -> FamilyDeployments:
        """The field with most deployments: what headlines are about."""
        return max(self.trips, key=lambda trip: len(trip.deployments))

    def spread(self, measure: Measure) -> Spread | None:
        """Return how a measure is spread in the main field."""
        return self.main.outcomes.spread(measure)

    def sections(self, tell: Tell = silent) -> tuple[Section, ...]:
        """Return the predictions as sections of a report."""
        design, profile = self.prepared.design, self.prepared.profile
        window, effects = self.window, self.effects
        parts: tuple[Callable[[], Section], ...] = (
            lambda: (
                window_section(window, burst_basis(profile))
                if window
                else pressure_section(design, profile)
            ),
            lambda: spread_section([trip.outcomes for trip in self.trips]),
            self._deployments,
            lambda: heat_section(self.heat),
            lambda: anchoring_section(self.holdings),
            lambda: sensitivity_section(effects, QUICK),
            lambda: tolerance_section(self.tolerance),
        )
        drawn = []
        for index, part in enumerate(parts):
            drawn.append(part())
            tell((index + 1) / len(parts), f"drawing: {drawn[-1].title.lower()}")
        return tuple(drawn)

    def report(self, origin: Origin, more: Sequence[Section] = (), tell: Tell = silent) -> Report:
        """Return the whole report."""
        words, tone = verdict_on(self.prepared.report, self.window)
        return Report(
            title=f"{self.prepared.design.name}: predictions and fabrication",
            verdict=words,
            tone=tone,
            cautions=cautions(self.prepared, self.window, self.main.outcomes),
            headlines=headlines(self.main.outcomes, self.window, self.holdings),
            facts=design_facts(self.prepared),
            sections=(
                *more,
                *self.sections(tell),
                *making_sections(self.prepared),
                assumption_section(self.prepared.profile, model_assumptions(self.trials.options)),
                repeat_section(origin.command, origin.inputs, origin.versions),
            ),
        )

    def page(self, origin: Origin, more: Sequence[Section] = (), tell: Tell = silent) -> str:
        """Return the whole report as HTML; parameters as in `report`."""
        return page_html(self.report(origin, more, tell))

    def _deployments(self) -> Section:
        design = self.prepared.design
        chosen: dict[int, str] = {}
        main = self.main
        for share, words in _SHARES:
            (index,) = typical(main.outcomes, SEEN.key, [share])
            chosen.setdefault(index, words)
        shown = [
            (self._caption(main, index, words), main.site(index).world, main.deployments[index])
            for index, words in chosen.items()
        ]
        for trip in self.trips:
            first = range(0, len(trip.deployments), self.trials.poses)
            shown += [
                (self._caption(trip, index, "first pose"), trip.site(index).world,
                 trip.deployments[index])
                for index in first
                if trip is not main or index not in chosen
            ]  # fmt: skip
        ended = [(trip.place.label, trip.deployments) for trip in self.trips]
        return deployment_section(
            design, shown[:MOST_PICTURES], ended, rules_text(self.trials.options)
        )

    @staticmethod
    def _caption(trip: FamilyDeployments, index: int, words: str) -> str:
        seen = SEEN.text(trip.outcomes.values[SEEN.key][index])
        return f"{trip.outcomes.maps[index]}, {words}: {seen} of the free space seen"


def predict(
    design: Design,
    profile: LaserProfile,
    fields: Sequence[MapFamily],
    trials: PredictionPlan | None = None,
    tell: Tell = silent,
) -> Predicted:
    """Deploy a design in fields of maps, measure everything, and check it with its deployments."""
    trials = trials or PredictionPlan()
    tell(0.0, "preparing maps")
    places = [PreparedFamily.of(field, trials) for field in fields]
    sizes = np.array([len(place.sites) for place in places]) / sum(len(p.sites) for p in places)
    ends = 0.05 + 0.45 * np.cumsum(sizes)
    trips = tuple(
        deploy_family(design, place, trials, part_of(tell, end - 0.45 * size, end))
        for place, size, end in zip(places, sizes.tolist(), ends.tolist(), strict=True)
    )
    main = max(trips, key=lambda trip: len(trip.deployments))
    bench = VariantBench(design, main.place, trials)
    effects = sensitivity(bench, part_of(tell, 0.5, 0.7))
    scatter = tolerance(bench, trials.seed, part_of(tell, 0.7, 0.92))
    tell(0.92, "where it goes on one map")
    heat = heat_map_of(design, places[0].sites[0], trials)
    tell(0.94, "design rules")
    deployments = [deployment for trip in trips for deployment in trip.deployments]
    prepared = prepare(design, profile, deployments)
    mass_g = _mass_g(prepared)
    return Predicted(
        prepared=prepared,
        trips=trips,
        trials=trials,
        window=window_of(design, profile, [trip.outcomes for trip in trips]),
        holdings=tuple(predict_anchoring(design, trip, profile.material, mass_g) for trip in trips),
        heat=heat,
        effects=effects,
        tolerance=scatter,
    )


def rules_text(options: GrowthOptions) -> str:
    """Return the growth model's choices in words."""
    children = "stay inside" if options.children_of_stuck == "stop" else "grow all the same"
    return (
        f"{options.body} body, head-on half-angle {deg(options.head_on_half_angle_rad):g} degrees "
        f"(assumed), children of a stuck branch {children}"
    )


def part_of(tell: Tell, start: float, end: float) -> Tell:
    """Return a teller for a part of the work."""
    return lambda share, words: tell(start + (end - start) * share, words)


def _mass_g(prepared: Prepared) -> float:
    """Return the mass of the robot's film from its bill of materials."""
    lines = bill_of_materials(prepared.job, prepared.profile)
    return next((line.value for line in lines if line.item == "robot film mass"), 0.0)
