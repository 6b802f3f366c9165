"""Maps: bounds, obstacles and starts of robots."""

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.atomic import write_text
from vinefab.core.errors import BadInputError
from vinefab.core.front_door import front_door
from vinefab.core.plain_text import counted
from vinefab.core.validation import LARGEST_MM
from vinefab.model.files.map_geojson import map_text, read_map
from vinefab.model.files.shipped import path_given
from vinefab.model.start import Pose, Start, are_valid, check_polygon, refuse_jagged
from vinefab.model.start_place import start_given, with_starts
from vinefab.model.target import Target, check_targets, target_from, targets_given

__all__ = ["Map", "Pose", "Start"]

_MANY_OBSTACLES = 1000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Map:
    """One instance of an environment, coordinates in millimetres.

    Parameters
    ----------
    name
        Name in reports.
    bounds
        Outer limit of the free space; a valid polygon (holes in it count as obstacles).
    obstacles
        Valid polygons, holes allowed; their interiors are solid. They may touch each other and
        reach over the bounds.
    starts
        Start poses, in free space.
    targets
        Places that robots are to touch; those without a name are called A, B, C ...
    environment
        Generator or importer of the map.
    seed
        The generator's seed, None for imported maps.
    facts
        Parameters of the generator or settings of the import; plain values.
    """

    name: str
    bounds: Polygon
    obstacles: tuple[Polygon, ...] = ()
    starts: tuple[Start, ...] = ()
    targets: tuple[Target, ...] = ()
    environment: str = "unknown"
    seed: int | None = None
    facts: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for key, kind in (("obstacles", Polygon), ("starts", Start)):
            given = getattr(self, key)
            if not isinstance(given, Sequence) or not all(isinstance(one, kind) for one in given):
                raise BadInputError(key, given, f"a {kind.__name__} for each, in a tuple")
            object.__setattr__(self, key, tuple(given))
        object.__setattr__(self, "targets", targets_given(self.targets, "targets"))
        check_polygon("bounds", self.bounds)
        # Those that are to be refused are found for all at once.
        items = np.array(self.obstacles, dtype=np.object_)
        near = (np.abs(shapely.bounds(items).reshape(-1, 4)) <= LARGEST_MM).all(axis=1)
        plain = shapely.get_type_id(items) == shapely.GeometryType.POLYGON
        for index in np.flatnonzero(near & plain):
            refuse_jagged(f"obstacle {index}", items[index])
        for index in np.flatnonzero(~(near & plain & are_valid(items))):
            check_polygon(f"obstacle {index}", self.obstacles[index])
        object.__setattr__(self, "facts", MappingProxyType(dict(self.facts)))

    def __repr__(self) -> str:
        width_mm, height_mm = self.size_mm
        counts = (
            (len(self.obstacles), "obstacle"),
            (self.wall_count, "wall"),
            (len(self.starts), "start"),
            *(((len(self.targets), "target"),) if self.targets else ()),
        )
        words = ", ".join(counted(count, word) for count, word in counts)
        return f"<Map {reprlib.repr(self.name)}: {width_mm:.5g} x {height_mm:.5g} mm, {words}>"

    @property
    def free_space(self) -> BaseGeometry:
        """Bounds minus obstacles: a Polygon or MultiPolygon, computed anew at each call."""
        # The second is as exact, and fast for scattered obstacles, but orders its parts otherwise.
        many = len(self.obstacles) > _MANY_OBSTACLES
        union = shapely.disjoint_subset_union_all if many else shapely.union_all
        return shapely.difference(self.bounds, union(np.array(self.obstacles, dtype=np.object_)))

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the bounds' box."""
        x_min, y_min, x_max, y_max = self.bounds.bounds
        return x_max - x_min, y_max - y_min

    @property
    def wall_count(self) -> int:
        """Number of straight edges of bounds and obstacles together."""
        polygons = (self.bounds, *self.obstacles)
        rings = sum(1 + len(polygon.interiors) for polygon in polygons)
        return int(shapely.get_num_coordinates(list(polygons)).sum()) - rings

    @classmethod
    def read(cls, path: str | PathLike[str]) -> "Map":
        """Return the map in a GeoJSON file, coordinates in millimetres.

        Files of other programs go through ``vinefab.maps.import_``.

        Parameters
        ----------
        path
            A file that `write` or ``vinefab map`` wrote, or plain polygons: the largest is the
            bounds and contains all others, the obstacles.

        Raises
        ------
        BadInputError
            If it cannot be a path, or a value in the file cannot be used.
        UnreadableFileError
            If there is no such file, or it is not JSON.

        Examples
        --------
        >>> Map.read("moon.geojson")
        Traceback (most recent call last):
        vinefab.core.errors.UnreadableFileError: moon.geojson: there is no such file
        """
        return read_map(path_given("map", path, "the path of a map file (GeoJSON)"), cls)

    def write(self, path: str | PathLike[str], *, force: bool = False) -> Path:
        """Write the map as GeoJSON, coordinates to 1e-6 mm; `read` gives it back.

        Parameters
        ----------
        path
            The file; missing folders are made.
        force
            Overwrite a file that vinefab did not write, or of another kind.

        Returns
        -------
        Path
            What was written.

        Raises
        ------
        BadInputError
            If ``path`` cannot be a path.
        CannotWriteError
            If the system refuses.
        ForeignFileError
            If the place is taken.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> from vinefab import maps
        >>> with TemporaryDirectory() as folder:
        ...     Map.read(maps.pegs(seed=1).write(f"{folder}/pegs.geojson")).name
        'pegs_1'
        """
        return write_text(path_given("path", path), map_text(self), force=force)

    def with_start(self, *starts: "Start | Pose | tuple[float, float, float] | str") -> "Map":
        """Return the map with other starts instead.

        Parameters
        ----------
        *starts
            A `Start`, a pose ``(x_mm, y_mm, heading_deg)``, or words as of ``--start``:
            ``"250,15,90+-10"``, ``"left side"``, ``"line 20,20 20,480, heading 0+-20"``,
            ``"area 0,0 50,480"`` (docs/maps.md has all of them).

        Raises
        ------
        BadInputError
            If the words are no start, or nothing of a start is in free space.

        Examples
        --------
        >>> from vinefab import maps
        >>> start = maps.pegs(seed=1).with_start("left side, heading 0+-20").starts[0]
        >>> start.area.geom_type, start.pose.heading_deg
        ('LineString', 0.0)
        """
        return with_starts(self, [start_given(one) for one in starts])

    def with_targets(
        self, *targets: "Target | tuple[float, float] | Mapping[str, object] | str"
    ) -> "Map":
        """Return the map with other targets instead.

        Parameters
        ----------
        *targets
            Points ``(x_mm, y_mm)``, targets, tables with the keys of one, or words as of
            ``--target``: ``"130,330"``, ``"shelf=130,330+-15"``.

        Raises
        ------
        BadInputError
            If one has nothing in free space, or two have one name.

        Examples
        --------
        >>> from vinefab import maps
        >>> world = maps.pegs(seed=1).with_targets((100, 100), "shelf=20,300+-15")
        >>> [(one.name, one.tolerance_mm) for one in world.targets]
        [('A', 20.0), ('shelf', 15.0)]
        """
        read = [target_from(one) if isinstance(one, str) else one for one in targets]
        named = targets_given(read, "targets")
        check_targets(self, named)
        return replace(self, targets=named)

    def info(self, *, width_mm: float | None = None, passages: int = 5) -> Any:  # noqa: ANN401
        """Return size, free area, narrowest passages and room for robots (computed).

        Parameters
        ----------
        width_mm
            Lay-flat width of a body: how much of the free area it has room in.
        passages
            How many of the narrowest passages to find.

        Returns
        -------
        MapInfo
            It shows itself in a notebook; ``summary`` in lines, ``numbers`` as plain values, and
            ``passages``, ``starts``, ``widest_mm`` and ``body``.

        Raises
        ------
        BadInputError
            If a value cannot be used.

        Examples
        --------
        >>> from vinefab import maps
        >>> maps.pegs(seed=1).info(width_mm=20).summary[0]
        'map: pegs_1'
        """
        return front_door().info_of(self, width_mm=width_mm, passages=passages)

    @property
    def summary(self) -> tuple[str, ...]:
        """Its size, its starts, what is odd about it and how it was made, a line each."""
        lines: tuple[str, ...] = front_door().map_summary(self)
        return lines

    def json_text(self) -> str:
        """Return the map as its file holds it: GeoJSON, ``vinefab/map-1``."""
        return map_text(self)

    def _repr_svg_(self) -> str | None:
        """Show the plan in a notebook."""
        drawn: str | None = front_door().svg_of(self)
        return drawn
