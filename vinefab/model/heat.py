"""Where robots go on one map, over many poses."""

from dataclasses import dataclass

from vinefab.core.errors import BadInputError
from vinefab.model.checked import Floats
from vinefab.model.map import Map


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """A place where branches get stuck again and again.

    Parameters
    ----------
    x_mm, y_mm
        Mean position of the stuck tips.
    percent
        Share of the deployments that had a branch stuck there.
    """

    x_mm: float
    y_mm: float
    percent: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Heat:
    """How often deployed bodies pass each place of a map.

    Parameters
    ----------
    world
        The map.
    low_mm
        Lower left corner of the raster.
    cell_mm
        Side of its cells.
    share
        Share of the deployments whose body covers each cell, shape (rows, columns), row 0 at the
        bottom, 0 to 1.
    deployments
        How many there were.
    spots
        Where branches got stuck, the most frequent first.
    spread
        How far the poses differ, in words.
    """

    world: Map
    low_mm: tuple[float, float]
    cell_mm: float
    share: Floats
    deployments: int
    spots: tuple[Spot, ...]
    spread: str

    def __post_init__(self) -> None:
        if self.share.ndim != 2 or not ((self.share >= 0.0) & (self.share <= 1.0)).all():
            raise BadInputError("share", self.share.shape, "shares from 0 to 1 in rows and columns")
        self.share.setflags(write=False)

    def percent_passed(self, least: float = 0.0) -> float:
        """Return the share of the free space that more than a share of the deployments cover.

        Bodies lie in free space, so that covered cells are free ones up to a cell's width.
        """
        passed_mm2 = float((self.share > least).sum()) * self.cell_mm**2
        return min(100.0, 100.0 * passed_mm2 / self.world.free_space.area)
