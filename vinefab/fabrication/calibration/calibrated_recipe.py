"""The result of a calibration: recipe file, lines for the user, JSON."""

import tomllib
from pathlib import Path
from typing import Any

import tomli_w

from vinefab.core.errors import BadInputError
from vinefab.core.jsontext import GENERATOR, json_text
from vinefab.core.plain_text import counted
from vinefab.fabrication.calibration.estimate import Estimate
from vinefab.fabrication.calibration.fit_recipe import Calibration
from vinefab.model.files.profile_toml import profile_of
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import read_toml
from vinefab.model.laser import EnergyWindow, Quantity, Standing, quantities

_OWN_TABLES = ("measured", "growth", "coupons", "lap")


def calibrated_text(calibration: Calibration, recipe: str | Path, out: Path, results: Path) -> str:
    """Return a recipe file with fitted numbers, as text."""
    if out.suffix != ".toml":
        raise BadInputError("--out", str(out), "a file that ends in .toml")
    document = read_toml(locate("recipe", recipe))
    before = document["name"]
    document["name"] = out.stem
    document["status"] = str(calibration.status)
    document["source"] = f"{before}, calibrated with {results.name}; before: {document['source']}"
    for place, estimate in calibration.numbers.items():
        table, key = place.split(".")
        target = _table(document, table)
        spread = {}
        if estimate.uncertainty > 0.0:
            spread["uncertainty"] = float(f"{estimate.uncertainty:.3g}")
            spread["uncertainty_95"] = float(f"{estimate.half_width():.3g}")
        measured = f"{results.name}: {counted(estimate.readings, 'reading')}"
        kept = f"published fit, scaled to this tube: {results.name} does not say"
        target[key] = Quantity(
            value=float(f"{estimate.value:.6g}"),
            standing=Standing.MEASURED if estimate.readings else Standing.ASSUMED,
            source=measured if estimate.readings else kept,
            **spread,
        ).content
    if calibration.windows:
        windows = [_window(window, results).content for window in calibration.windows]
        _table(document, "coupons")["windows"] = windows
    if calibration.lap_method is not None:
        _bond(document["lap"], calibration)
    return f"# {GENERATOR}\n{tomli_w.dumps(document)}"


def _table(document: dict[str, Any], name: str) -> dict[str, Any]:
    if name in _OWN_TABLES:
        found: dict[str, Any] = document.setdefault(name, {})
        return found
    operations: dict[str, Any] = document["operations"]
    sealed: dict[str, Any] = operations[name] if name in operations else document["sealer"]
    return sealed


def _bond(table: dict[str, Any], calibration: Calibration) -> None:
    """Set the bond of the laps tested, and leave no load of another bond or of less standing."""
    changed = table.get("method", "") != calibration.lap_method
    table["method"] = str(calibration.lap_method)
    measured = table.get("strength_n_per_mm", {}).get("standing") == Standing.MEASURED
    if "lap.strength_n_per_mm" in calibration.numbers:
        stale = "survived_n_per_mm" if changed else ""
    else:
        # What laps bore counts where none failed: it takes the place of an assumed strength.
        bore = "lap.survived_n_per_mm" in calibration.numbers
        stale = "strength_n_per_mm" if bore and (changed or not measured) else ""
    table.pop(stale, None)


def _window(window: EnergyWindow, results: Path) -> EnergyWindow:
    """Return a window whose ends name the file of their readings."""
    ends = quantities(window).items()
    return window.changed(
        **{name: end.changed(source=f"{results.name}: {end.source}") for name, end in ends}
    )


_SCHEMA = "vinefab/calibration-1"


def calibrated_recipe(
    calibration: Calibration, recipe: str | Path, out: Path, results: Path
) -> str:
    """Return the recipe file, read back to be sure that it is valid."""
    text = calibrated_text(calibration, recipe, out, results)
    profile_of(tomllib.loads(text), out)
    return text


def calibration_lines(calibration: Calibration) -> list[str]:
    """Return the fitted numbers as lines for the user."""
    numbers = calibration.numbers
    width = max((len(name) for name in numbers), default=0)
    lines = [f"{name:<{width}}  {_words(number)}" for name, number in numbers.items()]
    refused = [f"not fitted: {group}: {why}" for group, why in calibration.refused.items()]
    return [*lines, *calibration.remarks, *refused, f"status: {calibration.status}"]


def _words(number: Estimate) -> str:
    if number.readings == 0:
        return f"{number.value:.4g}  assumed"
    half = f" +- {number.half_width():.2g} (95 %)" if number.uncertainty > 0.0 else ""
    return f"{number.value:.4g}{half}  measured, {counted(number.readings, 'reading')}"


def calibration_json(calibration: Calibration) -> str:
    """Return the fitted numbers as JSON."""
    return json_text(
        _SCHEMA,
        {
            "status": str(calibration.status),
            "numbers": {
                name: {
                    "value": number.value,
                    "uncertainty": number.uncertainty,
                    "uncertainty_95": number.half_width(),
                    "readings": number.readings,
                }
                for name, number in calibration.numbers.items()
            },
            "windows": [
                {"least_mj_mm": None, "most_mj_mm": None} | window.content
                for window in calibration.windows
            ],
            "remarks": list(calibration.remarks),
            "refused": dict(calibration.refused),
        },
    )
