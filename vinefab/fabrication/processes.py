"""How texts speak of each process; its longer sentences stand in ``package/templates``."""

from collections.abc import Mapping
from dataclasses import dataclass

from vinefab.model.machine import Tool


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessWords:
    """The words of one process, for findings, bills and pages."""

    actor: str  # who does it: ``the laser``
    point: str  # what follows a path
    whose: str  # the same as an owner
    slow: str  # what it does to film where it moves too slowly
    recipe: str  # its recipe
    sheet: str  # what its sheets are for
    seam: str = "width of the seam"  # what is measured of it


WORDS: Mapping[Tool, ProcessWords] = {
    Tool.LASER: ProcessWords(
        actor="the laser",
        point="the beam",
        whose="the beam's",
        slow="burns",
        recipe="laser recipe",
        sheet="the laser",
        seam="width of the fused rim inward of any cut",
    ),
    Tool.HOT_TIP: ProcessWords(
        actor="a hot tip",
        point="the tip",
        whose="the tip's",
        slow="melts too much",
        recipe="recipe",
        sheet="the hot tip",
    ),
    Tool.KNIFE: ProcessWords(
        actor="a knife",
        point="the cut",
        whose="the cut's",
        slow="loses time",
        recipe="recipe",
        sheet="the knife",
    ),
    Tool.IMPULSE_SEALER: ProcessWords(
        actor="an impulse sealer",
        point="the seam",
        whose="the seam's",
        slow="melts too much",
        recipe="recipe",
        sheet="sealing by hand",
    ),
    Tool.SCISSORS: ProcessWords(
        actor="scissors",
        point="the cut",
        whose="the cut's",
        slow="loses time",
        recipe="recipe",
        sheet="cutting by hand",
    ),
}
"""The words of every process, by its tool."""
