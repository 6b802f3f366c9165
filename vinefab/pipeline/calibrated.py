"""What `vinefab calibrate` writes and says."""

import tomllib
from pathlib import Path

from vinefab.core.jsontext import json_text
from vinefab.export.job_json import plain_quantity
from vinefab.files.profile import profile_of
from vinefab.files.recipe import calibrated_text
from vinefab.physics.estimate import Estimate
from vinefab.pipeline.calibrate import Calibration

SCHEMA = "vinefab/calibration-1"


def calibrated_recipe(
    calibration: Calibration, recipe: str | Path, out: Path, results: Path
) -> str:
    """Return the recipe file, read again as it will lie and found to be usable.

    Raises
    ------
    BadInputError, UnknownNameError
        If the recipe could not be read where it is to lie: its machine and material are looked
        for beside it, then by name.
    """
    text = calibrated_text(
        recipe,
        out,
        calibration.numbers,
        windows=calibration.windows,
        status=calibration.status,
        results=results,
    )
    profile_of(tomllib.loads(text), out)
    return text


def calibration_lines(calibration: Calibration) -> list[str]:
    """Return what was fitted, as lines for the user."""
    numbers = calibration.numbers
    width = max((len(name) for name in numbers), default=0)
    lines = [
        f"{name:<{width}}  {_words(number)}  measured,"
        f" {number.readings} reading{'s' if number.readings > 1 else ''}"
        for name, number in numbers.items()
    ]
    return [*lines, *calibration.remarks, f"status: {calibration.status}"]


def _words(number: Estimate) -> str:
    spread = f" +- {number.uncertainty:.2g}" if number.uncertainty > 0.0 else ""
    return f"{number.value:.4g}{spread}"


def calibration_json(calibration: Calibration) -> str:
    """Return what was fitted as JSON."""
    return json_text(
        SCHEMA,
        {
            "status": str(calibration.status),
            "numbers": {
                name: {
                    "value": number.value,
                    "uncertainty": number.uncertainty,
                    "readings": number.readings,
                }
                for name, number in calibration.numbers.items()
            },
            "windows": [
                {
                    "operation": window.operation,
                    "focus_mm": window.focus_mm,
                    **{
                        name: None if energy is None else plain_quantity(energy)
                        for name, energy in (
                            ("least_mj_mm", window.least_mj_mm),
                            ("most_mj_mm", window.most_mj_mm),
                        )
                    },
                }
                for window in calibration.windows
            ],
            "remarks": list(calibration.remarks),
        },
    )
