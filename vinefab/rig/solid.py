"""Plans into closed solids, by manifold3d."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from manifold3d import CrossSection, FillRule, Manifold, Mesh64

from vinefab.core.validation import Floats, Ints
from vinefab.rig.clean import Pieces


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hollow:
    """A prism to be taken out of a solid."""

    pieces: Pieces  # its outline, in plan
    # low_mm, high_mm: from where to where it reaches up; below 0 to open it downwards
    low_mm: float
    high_mm: float


def stacked(
    plate: Pieces,
    solids: Pieces,
    plate_mm: float,
    height_mm: float,
    hollows: Sequence[Hollow | Manifold] = (),
) -> tuple[Floats, Ints]:
    """Return corners and triangles of solids standing on a plate.

    The plate fills z from 0 to ``plate_mm``, what stands on it reaches from there up by
    ``height_mm``.
    """
    body = _extruded(plate, plate_mm)
    if len(solids):
        # From the middle of the plate: bodies that overlap join more surely than ones that touch.
        body += _extruded(solids, 0.5 * plate_mm + height_mm).translate((0, 0, 0.5 * plate_mm))
    for hollow in hollows:
        body -= hollow if isinstance(hollow, Manifold) else _prism(hollow)
    mesh = body.to_mesh64()
    vertices = np.asarray(mesh.vert_properties[:, :3], dtype=np.float32).astype(np.float64)
    return _sorted(vertices, np.asarray(mesh.tri_verts, dtype=np.int64))


def manifold_of(vertices_mm: Floats, faces: Ints) -> Manifold:
    """Return corners and triangles as a solid of manifold3d, empty when they do not bound one."""
    # Copies: manifold3d does not take read-only arrays.
    vertices = np.array(vertices_mm, dtype=np.float64, order="C")
    return Manifold(Mesh64(vertices, np.array(faces, dtype=np.uint64, order="C")))


def outlines_at(body: Manifold, z_mm: float) -> shapely.geometry.base.BaseGeometry:
    """Return the cross-section of a solid at a height, as polygons."""
    rings = [shapely.linearrings(ring) for ring in body.slice(z_mm).to_polygons()]
    # Outer rings run counter-clockwise and holes clockwise: crossing counts do not need to know.
    return shapely.build_area(shapely.union_all(rings)) if rings else shapely.Polygon()


def _prism(hollow: Hollow) -> Manifold:
    body = _extruded(hollow.pieces, hollow.high_mm - hollow.low_mm)
    return body.translate((0.0, 0.0, hollow.low_mm))


def _extruded(pieces: Pieces, height_mm: float) -> Manifold:
    rings = shapely.get_rings(shapely.orient_polygons(pieces))
    contours = [shapely.get_coordinates(ring)[:-1] for ring in rings]
    return Manifold.extrude(CrossSection(contours, FillRule.Positive), height_mm)


def _sorted(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Put corners and triangles in an order that depends on the shape alone."""
    order = np.lexsort(vertices.T[::-1])
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    faces = place[faces]
    first = faces.argmin(axis=1)
    rows = np.arange(len(faces))[:, None]
    faces = faces[rows, (first[:, None] + np.arange(3)) % 3]
    return vertices[order], faces[np.lexsort(faces.T[::-1])]
