"""The numbers of a report as they stand in JSON, ``vinefab/prediction-1``.

Every number is rounded as the page shows it, so that both say the same.
"""

from collections.abc import Mapping
from dataclasses import asdict

from vinefab.core.units import deg
from vinefab.prediction.anchoring_prediction import AnchoringPrediction, HeldForces
from vinefab.prediction.heat_map import HeatMap
from vinefab.prediction.measures import MEASURES, MeasureTable, spreads_content
from vinefab.prediction.pressure_window import Need, PressureWindow
from vinefab.prediction.sensitivity import QUICK_MEASURES, Effect, Tolerance


def field_content(outcomes: MeasureTable) -> dict[str, object]:
    """Return the outcomes on one family of maps as they stand in JSON."""
    return {
        "label": outcomes.label,
        "maps": outcomes.map_count,
        "spread": spreads_content(outcomes),
        "deployments": [_deployment(outcomes, index) for index in range(len(outcomes))],
    }


def _deployment(outcomes: MeasureTable, index: int) -> dict[str, object]:
    pose = outcomes.poses[index]
    values = {}
    for measure in MEASURES:
        # A robot that never emerged needs no pressure: there is no number then.
        values[measure.key] = measure.content(outcomes.values[measure.key][index])
    return {
        "map": outcomes.maps[index],
        "pose": {
            "x_mm": round(pose.x_mm, 2),
            "y_mm": round(pose.y_mm, 2),
            "heading_deg": round(deg(pose.heading_rad), 2),
        },
        **values,
    }


def window_content(window: PressureWindow) -> dict[str, object]:
    """Return a pressure window as it stands in JSON."""
    return {
        "is_open": window.is_open,
        "needed_kpa": round(window.needed_kpa, 1),
        "allowed_kpa": round(window.allowed_kpa, 1),
        "working_kpa": window.working_kpa,
        "safety_factor": window.safety_factor,
        "standing": window.standing.value,
        "needs": [_need(need) for need in (window.loose, window.tight)],
        "widths": [
            {
                "part": level.name,
                "width_mm": round(level.width_mm, 2),
                "inflated_mm": round(level.inflated_mm, 2),
                "burst_kpa": round(level.burst_kpa, 1),
                "allowed_kpa": round(level.allowed_kpa, 1),
                "strain_percent": round(level.strain_percent),
            }
            for level in window.levels
        ],
    }


def _need(need: Need) -> dict[str, object]:
    numbers = {name: round(value, 1) for name, value in asdict(need).items() if name != "storage"}
    return {"film_stored": need.storage, **numbers}


def anchoring_content(found: AnchoringPrediction) -> dict[str, object]:
    """Return an anchoring prediction as it stands in JSON."""
    percents = ("engaged_percent", "nothing_percent", "limited_percent")
    return {
        "label": found.label,
        "leaves": found.leaves,
        "has_pouches": found.has_pouches,
        "pressure_kpa": found.pressure_kpa,
        "held": [_held_content(held) for held in found.held],
        **{name: round(getattr(found, name), 1) for name in percents},
    }


def _held_content(held: HeldForces) -> dict[str, object]:
    parts = ("engaged", "some_idle", "ideal", "force_n")
    return {
        "friction": held.friction,
        **{
            part: {name: round(v, 2) for name, v in asdict(getattr(held, part)).items()}
            for part in parts
        },
    }


def heat_content(heat: HeatMap) -> dict[str, object]:
    """Return a heat map as it stands in JSON."""
    return {
        "map": heat.world.name,
        "deployments": heat.deployments,
        "cell_mm": round(heat.cell_mm, 2),
        "ever_passed_percent": round(heat.percent_passed(), 1),
        "mostly_passed_percent": round(heat.percent_passed(0.5), 1),
        "stuck": [{name: round(v, 1) for name, v in asdict(spot).items()} for spot in heat.spots],
    }


def effect_content(effect: Effect) -> dict[str, object]:
    """Return a sensitivity as it stands in JSON."""
    changes: dict[str, Mapping[str, float | None]] = {}
    for measure in QUICK_MEASURES:
        change = effect.changes.get(measure.key)
        if change is not None:
            numbers = {"mean": change.mean, "low": change.low, "high": change.high}
            changes[measure.key] = {name: measure.content(v) for name, v in numbers.items()}
    return {
        "knob": effect.knob,
        "step": effect.step,
        "unit": effect.unit,
        "poses": effect.count,
        "changes": changes,
    }


def tolerance_content(tolerance: Tolerance) -> dict[str, object]:
    """Return the scatter from fabrication as it stands in JSON."""
    return {
        "length_percent": tolerance.length_percent,
        "angle_deg": tolerance.angle_deg,
        "robots": tolerance.robots,
        "launches": tolerance.launches,
        "scatter": {
            scatter.measure.key: {
                name: scatter.measure.rounded(getattr(scatter, name))
                for name in ("exact", "p05", "p95", "typical")
            }
            for scatter in tolerance.scatter
        },
    }
