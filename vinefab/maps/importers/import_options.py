"""What a user says about a file to import; light, as the help of the command reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from vinefab.core.errors import BadInputError
from vinefab.maps.importers.photo_options import PhotoOptions

if TYPE_CHECKING:
    from pathlib import Path

    from vinefab.model.map import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """Options of an import; None leaves the choice to the importer.

    Parameters
    ----------
    scale_mm_per_unit
        Millimetres of the map per unit of the source (per metre for ROS maps, per pixel for
        photos), instead of the unit that the source names.
    simplify_mm
        Largest distance between imported walls and those of the source.
    unknown
        Meaning of cells of a ROS map that were never seen: ``obstacle`` or ``free``.
    least_obstacle_mm2
        Obstacles of a ROS map or a photo smaller than this are left out, as noise.
    start
        Where robots start, in the map's millimetres.
    join_mm
        Widest gap in an outline that is closed.
    layers
        Names of the layers (DXF, GeoPackage) or groups (SVG) to read; empty for all.
    drawn
        What the areas of a drawing are: ``obstacles`` (and bounds), or ``free``: their union is
        the free space, its holes are obstacles. Otherwise ``obstacles``, but ``free`` where no
        outline contains all others and nothing else can be meant.
    bounds
        ``outline``: the largest outline, free inside, must contain everything else. ``largest``:
        the same, but what lies outside of it is left out. ``wall``: the largest outline is the
        outer face of a solid wall and the outlines in it are rooms. ``box``: a rectangle around
        everything.
    margin_mm
        Around the drawing when the bounds are a box.
    wall_mm
        Thickness of walls that are drawn as lines; otherwise lines enclose.
    open_lines
        ``refuse`` or ``drop`` lines that enclose nothing.
    photo
        What is known of a photo or scan: its scale, and what its obstacles look like.
    """

    scale_mm_per_unit: float | None = None
    simplify_mm: float | None = None
    unknown: str | None = None
    least_obstacle_mm2: float | None = None
    start: Pose | None = None
    join_mm: float | None = None
    layers: tuple[str, ...] = ()
    drawn: Literal["obstacles", "free"] | None = None
    bounds: Literal["outline", "largest", "wall", "box"] | None = None
    margin_mm: float | None = None
    wall_mm: float | None = None
    open_lines: Literal["refuse", "drop"] | None = None
    photo: PhotoOptions | None = None

    def refuse(self, names: tuple[str, ...], kind: str, source: Path) -> None:
        """Raise BadInputError if an option was given that means nothing for a kind of file."""
        for name in names:
            value = getattr(self, name)
            if value is not None and value != ():
                option = {"open_lines": "open", "layers": "layer"}.get(name, name)
                raise BadInputError(option, value, f"nothing for {kind}", source)
