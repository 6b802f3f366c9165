"""The printable rig of a map."""

from dataclasses import dataclass

from vinefab.core.errors import ReadBackError
from vinefab.export.rigfiles import rig_files
from vinefab.model.map import Map
from vinefab.model.printer import Printer
from vinefab.rig.assembled import compare_with_map
from vinefab.rig.build import build_rig
from vinefab.rig.options import RigOptions
from vinefab.rig.part import Rig

MOST_DIFFERENCE = 1e-3
"""Largest share of the walls by which an assembled rig may differ from its map."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigFiles:
    """A rig as files.

    Parameters
    ----------
    rig
        The rig.
    files
        Content by file name; every STL file has been read again.
    difference
        Share of the walls by which the assembled rig differs from the map.
    """

    rig: Rig
    files: dict[str, bytes]
    difference: float

    def summary(self) -> list[str]:
        """Return the rig in a few lines for the user."""
        rig = self.rig
        return [
            f"{rig.name}: {len(rig.parts)} parts for {rig.printer.name}, "
            f"{rig.volume_mm3 / 1000:.0f} cm3 (computed)",
            f"every STL read back closed and oriented; assembled, the walls differ from the map "
            f"by {100 * self.difference:.4f} %",
            *(f"note: {note}" for note in rig.notes),
        ]


def make_rig(world: Map, printer: Printer, options: RigOptions) -> RigFiles:
    """Return the files of a map's rig.

    Raises
    ------
    BadInputError
        If the rig cannot be printed.
    ReadBackError
        If a file, read again, is not what it should be, or the assembled rig is not the map.
    """
    rig = build_rig(world, printer, options)
    comparison = compare_with_map(rig, world)
    if comparison.share > MOST_DIFFERENCE:
        problem = f"assembled, its walls differ from the map by {100 * comparison.share:.3f} %"
        raise ReadBackError(f"rig of {world.name}", problem)
    return RigFiles(rig=rig, files=rig_files(rig, world, comparison), difference=comparison.share)
