"""Skeletons as drawings for other programs: DXF, SVG, GeoJSON and CSV, all in millimetres.

`vinefab.maps.importers.skeleton_lines` reads them back. Tapers, fillets and pouches are not drawn.
"""

import csv
import io
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import svgwrite
from ezdxf.filemanagement import new

from vinefab.core.plain_text import GENERATOR, counted, json_text, one_line
from vinefab.core.validation import Floats
from vinefab.core.view import Answer, Block, Picture, Result
from vinefab.fabrication.formats.dxf_format import METRIC, MILLIMETRES, VERSION, fixed_metadata
from vinefab.maps.importers.skeleton_lines import BASE_NAME
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Pose
from vinefab.model.tree import BranchTree

FREE_POSE = Pose(x_mm=0.0, y_mm=0.0, heading_rad=np.pi / 2)
"""Where a skeleton in free space stands: its base in the origin, its trunk upward."""

LAYER = "skeleton"


@dataclass(frozen=True, slots=True, kw_only=True)
class SkeletonBranch:
    """A branch as its middle line."""

    id: str
    name: str  # in its design's file; its id where it has none
    parent: str | None  # id of its parent
    points_mm: Floats  # base, bends and contacts, tip, shape (k, 2)
    width_mm: float  # lay-flat, at its base


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Skeleton(Result):
    """The middle lines of a robot's branches, parents before children.

    Parameters
    ----------
    design
        Name of the design.
    where
        What it stands in: ``in free space``, or ``on`` a map.
    pose
        Of the trunk's base.
    branches
        Those that have a length.
    """

    design: str
    where: str
    pose: Pose
    branches: tuple[SkeletonBranch, ...]

    @classmethod
    def of_design(cls, design: Design, pose: Pose = FREE_POSE) -> "Skeleton":
        """Return the skeleton of a design where nothing is in the way."""
        chains = free_chains_mm(design.tree, pose)
        return cls._of(design, "in free space", pose, chains)

    @classmethod
    def of_deployment(cls, deployment: Deployment, design: Design, where: str) -> "Skeleton":
        """Return the skeleton of a grown robot; branches that never emerged are left out."""
        chains = [deployment.chain_mm(row) for row in range(len(deployment.tree))]
        return cls._of(design, where, deployment.pose, chains)

    @classmethod
    def _of(cls, design: Design, where: str, pose: Pose, chains: Sequence[Floats]) -> "Skeleton":
        tree, ids = design.tree, design.tree.ids
        names = design.names or ids
        branches = tuple(
            SkeletonBranch(
                id=ids[row],
                name=names[row],
                parent=None if tree.parent[row] < 0 else ids[tree.parent[row]],
                points_mm=chain,
                width_mm=float(tree.width_mm[row]),
            )
            for row, chain in enumerate(chains)
            if len(chain) > 1
        )
        return cls(design=design.name, where=where, pose=pose, branches=branches)

    @property
    def length_mm(self) -> float:
        """Length of all lines."""
        steps = (np.diff(one.points_mm, axis=0) for one in self.branches)
        return float(sum(np.hypot(*step.T).sum() for step in steps))

    def view(self) -> Iterator[Block]:
        """Yield how many branches there are, and a picture."""
        yield Answer(
            f"{self.design} {self.where} from {self.pose.text}: "
            f"{counted(len(self.branches), 'branch')}, {self.length_mm:.1f} mm"
        )
        yield Picture(image=lambda: self.file(".svg"), caption="Its skeleton.")

    def json_text(self) -> str:
        """Return every branch with its points as JSON: ``vinefab/skeleton-1``."""
        branches = [
            {
                "id": one.id,
                "name": one.name,
                "parent": one.parent,
                "points_mm": _rounded(one.points_mm),
                "width_mm": one.width_mm,
            }
            for one in self.branches
        ]
        content = {"design": self.design, "pose": self.pose.content, "branches": branches}
        return json_text("vinefab/skeleton-1", content)

    def file(self, suffix: str) -> bytes:
        """Return the skeleton as a file of the kind of a suffix, one of `KINDS`."""
        return KINDS[suffix.lower()](self).encode()


def free_chains_mm(tree: BranchTree, pose: Pose) -> list[Floats]:
    """Return base, bends and tip of every branch where nothing is in the way, each (k, 2)."""
    parts = tree.straight
    begin_mm, end_mm, _ = parts.laid_out((pose.x_mm, pose.y_mm), pose.heading_rad)
    return [
        np.concatenate([begin_mm[own[:1]], end_mm[own]])
        for own in (np.flatnonzero(parts.branch == row) for row in range(len(tree)))
    ]


def _rounded(points_mm: Floats) -> list[list[float]]:
    digits = 9  # after the point, of a coordinate in mm
    # Adding 0 turns a rounded -0.0 into 0.0.
    return (np.round(points_mm, digits) + 0.0).tolist()  # type: ignore[no-any-return]


def _csv(skeleton: Skeleton) -> str:
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow(("x1", "y1", "x2", "y2", "width"))
    for one in skeleton.branches:
        for begin, end in pairwise(_rounded(one.points_mm)):
            table.writerow((*begin, *end, one.width_mm))
    return stream.getvalue()


def _dxf(skeleton: Skeleton) -> str:
    with fixed_metadata():
        document = new(VERSION, units=MILLIMETRES)
        document.header["$MEASUREMENT"] = METRIC
        document.layers.add(LAYER)
        document.layers.add(BASE_NAME, color=1)
        space = document.modelspace()
        for one in skeleton.branches:
            lines = space.add_lwpolyline(_rounded(one.points_mm), dxfattribs={"layer": LAYER})
            lines.dxf.const_width = one.width_mm
        space.add_point((skeleton.pose.x_mm, skeleton.pose.y_mm), dxfattribs={"layer": BASE_NAME})
        for name in sorted(document.entitydb.dxf_types_in_use()):
            document.classes.add_class(name)
        stream = io.StringIO()
        document.write(stream)
    return f"999\n{GENERATOR}\n{stream.getvalue()}"


def _svg(skeleton: Skeleton) -> str:
    places = np.concatenate([one.points_mm for one in skeleton.branches])
    margin_mm = max(one.width_mm for one in skeleton.branches)
    low, high = np.floor(places.min(axis=0) - margin_mm), np.ceil(places.max(axis=0) + margin_mm)
    width, height = (high - low).tolist()
    drawing = svgwrite.Drawing(
        size=(f"{width:g}mm", f"{height:g}mm"),
        viewBox=f"{low[0]:.0f} {-high[1]:.0f} {width:g} {height:g}",
        debug=False,
    )
    drawing.set_desc(title=one_line(skeleton.design), desc=GENERATOR)
    style = {"fill": "none", "stroke_linejoin": "round", "stroke_linecap": "round"}
    tubes = drawing.add(drawing.g(id=LAYER, stroke="#2b6cb0", stroke_opacity=0.35, **style))
    upside_down = np.array([1.0, -1.0])
    for one in skeleton.branches:
        lines = drawing.polyline(
            _rounded(one.points_mm * upside_down),
            id=f"branch_{one.id}",
            stroke_width=one.width_mm,
        )
        lines.attribs["data-width"] = one.width_mm
        lines.attribs["data-name"] = one.name
        tubes.add(lines)
    base = (skeleton.pose.x_mm, -skeleton.pose.y_mm)
    drawing.add(drawing.circle(base, 0.1 * margin_mm, id=BASE_NAME, fill="#c53030"))
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{drawing.tostring()}\n'


def _geojson(skeleton: Skeleton) -> str:
    features = [
        _feature(
            {"type": "LineString", "coordinates": _rounded(one.points_mm)},
            {"id": one.id, "name": one.name, "width": one.width_mm},
        )
        for one in skeleton.branches
    ]
    base = [skeleton.pose.x_mm, skeleton.pose.y_mm]
    features.append(_feature({"type": "Point", "coordinates": base}, {"name": BASE_NAME}))
    head = f'{{"type": "FeatureCollection",\n"generator": {json.dumps(GENERATOR)},\n"features": [\n'
    return head + ",\n".join(features) + "\n]}\n"


def _feature(geometry: dict[str, object], properties: dict[str, object]) -> str:
    return json.dumps({"type": "Feature", "properties": properties, "geometry": geometry})


KINDS: dict[str, Callable[[Skeleton], str]] = {
    ".csv": _csv,
    ".dxf": _dxf,
    ".geojson": _geojson,
    ".svg": _svg,
}
"""What writes each kind of file, by its suffix."""
