"""What a user says about a file to import; light, as the help of the command reads it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Literal

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.limits import number, positive
from vinefab.core.plain_text import counted

if TYPE_CHECKING:
    from pathlib import Path

    from vinefab.model.map import Pose

PHOTO_SUFFIXES = (".png", ".jpg", ".jpeg")

SCALES = (
    "--points 'X,Y;X,Y' (pixels of the photo) with --distance-mm, four --points with "
    "--rectangle-mm W,H, --marker-mm SIDE, or --scale-mm-per-unit (mm per pixel)"
)
"""The source of a photo's scale, as text."""

_MOST_PX = 1e5


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoOptions:
    """Options of the import of a photo or scan.

    Parameters
    ----------
    points_px
        Places in the photo, (column, row) from its upper left corner, as picture viewers count:
        two whose distance is known, or the four corners of a rectangle, its lower left one first,
        then counter-clockwise.
    distance_mm
        Between two points, or between the middles of the two markers with the lowest numbers,
        which says more of the scale than the size in which markers are seen.
    rectangle_mm
        Width and height of the rectangle whose corners four points are.
    marker_mm
        Side of the black frame of the ArUco markers (DICT_4X4_50) in the photo; one is enough, all
        have this size and lie in one plane.
    marker_count
        How many markers lie there: a photo that shows fewer of them is refused.
    height_mm
        How far the obstacles stand above the points or markers; their walls are vertical.
    obstacles
        ``dark``, ``light``, or a colour ``R,G,B`` or ``R,G,B,TOLERANCE``, 0 to 255 each.
    threshold
        Brightness between floor and obstacles, 0 to 255; found from the photo (Otsu) when None.
    crop_mm
        Left, low, right and top of the imported part, in map coordinates.
    """

    points_px: tuple[tuple[float, float], ...] = ()
    distance_mm: float | None = None
    rectangle_mm: tuple[float, float] | None = None
    marker_mm: float | None = None
    marker_count: int | None = None
    height_mm: float = 0.0
    obstacles: str = "dark"
    threshold: float | None = None
    crop_mm: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        for value in (value for point in self.points_px for value in point):
            number("points", value, -_MOST_PX, _MOST_PX, "px")
        lengths = {"distance_mm": [self.distance_mm], "marker_mm": [self.marker_mm]}
        for key, given_mm in {**lengths, "rectangle_mm": self.rectangle_mm or ()}.items():
            for length_mm in given_mm:
                if length_mm is not None:
                    positive(key, length_mm)
        if self.marker_count is not None:
            number("marker_count", self.marker_count, 1, 50)
            if self.marker_mm is None:
                raise UnfitInputError(
                    "marker_count", "needs the size of the markers", "give --marker-mm"
                )
        number("height_mm", self.height_mm, 0.0, 1e5, "mm")
        if self.threshold is not None:
            number("threshold", self.threshold, 0.0, 255.0)
        for value in self.crop_mm or ():
            number("crop", value, -1e7, 1e7, "mm")
        wanted = {2: "distance_mm", 4: "rectangle_mm"}
        given = [key for key in wanted.values() if getattr(self, key) is not None]
        count = len(self.points_px)
        if count and count not in wanted:
            problem = f"{counted(count, 'point')} {'is' if count == 1 else 'are'} given"
            raise UnfitInputError("points", problem, "give two, or the four of a rectangle")
        if count and given != [wanted[count]]:
            option = "--" + wanted[count].replace("_", "-")
            found = ", ".join(given).replace("_", "-") or "nothing"
            problem = f"{counted(count, 'point')} are given with {found}"
            raise UnfitInputError("points", problem, f"give them with {option}")
        with_markers = self.marker_mm is not None and given == ["distance_mm"]
        if given and not count and not with_markers:
            need = {"distance_mm": "two", "rectangle_mm": "four"}[given[0]]
            raise UnfitInputError(given[0], "needs points of the photo", f"give {need} --points")
        colour = self.colour
        if colour is not None and self.threshold is not None:
            raise UnfitInputError(
                "threshold",
                "is for dark or light obstacles, and a colour has its tolerance",
                "give --obstacles R,G,B,TOLERANCE",
            )

    def ensure_one_scale(self, mm_per_pixel: float | None) -> None:
        """Raise BadInputError unless there is just one thing that gives the photo its scale."""
        given = {
            "points": self.points_px or None,
            "marker_mm": self.marker_mm,
            "scale_mm_per_unit": mm_per_pixel,
        }
        names = [name for name, value in given.items() if value is not None]
        if not names:
            raise BadInputError("scale of the photo", None, SCALES)
        if len(names) > 1:
            raise UnfitInputError(
                names[1], f"is given together with {names[0]}", "leave one of them out"
            )

    def refuse(self, source: Path) -> None:
        """Raise BadInputError naming an option that was given: the file is not a photo."""
        for field in fields(self):
            value = getattr(self, field.name)
            if value != field.default:
                option = {"points_px": "points", "crop_mm": "crop"}.get(field.name, field.name)
                problem = f"is for photos and scans ({', '.join(PHOTO_SUFFIXES)}) alone"
                raise UnfitInputError(option, problem, "leave it out", source)

    @property
    def colour(self) -> tuple[float, ...] | None:
        """Red, green, blue and tolerance of the obstacles, or None if brightness tells them."""
        if self.obstacles in ("dark", "light"):
            return None
        try:
            values = tuple(float(part) for part in self.obstacles.split(","))
        except (ValueError, AttributeError):
            values = ()
        if len(values) not in (3, 4) or not all(0.0 <= value <= 255.0 for value in values):
            allowed = "dark, light, or a colour R,G,B or R,G,B,TOLERANCE, 0 to 255 each"
            raise BadInputError("obstacles", self.obstacles, allowed)
        tolerance = 60.0
        return values if len(values) == 4 else (*values, tolerance)


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
        ``refuse`` or ``drop`` lines that enclose nothing; or make them a ``wall`` of ``wall_mm``,
        while lines that enclose are outlines.
    flatten
        A drawing in space is seen from above, whatever its heights (DXF).
    photo
        The known facts of a photo or scan: its scale, and the look of its obstacles.
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
    open_lines: Literal["refuse", "drop", "wall"] | None = None
    flatten: bool = False
    photo: PhotoOptions | None = None

    def refuse(self, names: tuple[str, ...], kind: str, source: Path) -> None:
        """Raise BadInputError if an option was given that means nothing for a kind of file."""
        for name in names:
            value = getattr(self, name)
            if value not in (None, (), False):
                option = {"open_lines": "open", "layers": "layer"}.get(name, name)
                raise UnfitInputError(option, f"means nothing for {kind}", "leave it out", source)
