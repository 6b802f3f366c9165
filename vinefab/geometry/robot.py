"""One robot of a sheet: its paths, and where they lie."""

from dataclasses import dataclass, replace

from vinefab.geometry.passes import BodyPaths
from vinefab.geometry.placement import Placement
from vinefab.model.design import Design
from vinefab.model.job import LaserPath
from vinefab.model.outline import Contour


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Robot:
    """One robot on a sheet.

    Parameters
    ----------
    design
        What it is.
    body
        Its paths in the flat layout.
    placement
        Where it lies, or None where there was no room for it.
    number, count
        Which of how many robots that found room; the label beside it says so too.
    """

    design: Design
    body: BodyPaths
    placement: Placement | None
    number: int = 1
    count: int = 1

    @property
    def title(self) -> str:
        """Its name and, where it is not alone, its number."""
        alone = self.count == 1
        return self.design.name + ("" if alone else f", part {self.number} of {self.count}")

    @property
    def paths(self) -> tuple[LaserPath, ...]:
        """Its paths on the sheet; none without a place."""
        return tuple(self.moved(path) for path in self.body.paths if self.placement)

    def moved(self, path: LaserPath) -> LaserPath:
        """Return one of its paths where it lies, called by the robot's title."""
        label = path.label.removesuffix(self.design.name) + self.title
        return replace(path, contour=self.on_sheet(path.contour), label=label)

    def on_sheet(self, contour: Contour) -> Contour:
        """Return a contour of the flat layout where it lies."""
        return contour if self.placement is None else self.placement.moved(contour)
