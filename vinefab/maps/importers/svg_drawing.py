"""SVG drawings as a browser shows them: groups, uses, clips and styles, down to outlines.

Elements are walked and moved here: `svgelements` draws symbols that are not used, and knows no view
box of those that are.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import tinycss2.color4
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import (
    BadInputError,
    UnfitInputError,
    UnknownNameError,
    UnreadableFileError,
    located,
)
from vinefab.core.validation import Floats
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.source_drawing import (
    DrawingItem,
    DrawingReader,
    Ring,
    SourceDrawing,
    Straight,
    drawing_map,
    run_flat,
)
from vinefab.maps.importers.svg_document import (
    INHERITED,
    Node,
    View,
    about,
    after,
    cascade,
    font_px,
    length_px,
    page_frame,
    read_nodes,
    transform,
    transform_origin,
    viewport,
)
from vinefab.maps.importers.svg_shapes import SHAPES, Subpath, moved, svg_outlines
from vinefab.model.map import Map

WIDTH_ATTRIBUTE = "data-width"
"""Of a line of a skeleton: its lay-flat width in user units; strokes are for the eye."""

_GROUPS = {"svg", "g", "a", "switch", "symbol"}
_DRAWN = _GROUPS | SHAPES | {"use"}
_SILENT = {
    "defs", "title", "desc", "metadata", "style", "script", "namedview", "clipPath", "mask",
    "marker", "pattern", "linearGradient", "radialGradient", "filter", "symbol",
}  # fmt: skip
_ANIMATIONS = {"animateTransform", "animateMotion", "animate", "set"}
_PAINT_ONLY = {"fill", "stroke", "color", "stroke-width", "stroke-dashoffset", "stop-color"}
_GLYPH = re.compile(
    r"#(?:glyph[-_]?\d|font_\d+_\d+$|MJX-|g\d+-\d+$|[A-Z]\w*(?:Sans|Serif|Mono|Math|Cm)\w*-)"
)
"""What programs call the letters that they draw by ``use``: cairo (also pdftocairo), MuPDF,
MathJax, dvisvgm, matplotlib."""
_PAGE_IS_AREA = (
    "its background is an outline too; --drawn free if the areas on it are the free space"
)


@dataclass(frozen=True, slots=True)
class _Place:
    """What an element takes from those around it."""

    matrix: Floats
    layers: tuple[str, ...]
    style: dict[str, str]  # inherited properties
    view: View
    clip: BaseGeometry | None = None  # what is shown, in user units of the page; None for all
    uses: tuple[str, ...] = ()  # names of the elements that are used around it
    size: tuple[float, float] | None = None  # of a symbol or svg, by the use around it

    @property
    def fills(self) -> bool:
        """Whether areas are painted."""
        return _is_painted(self.style["fill"]) and not _is_nil(self.style["fill-opacity"])

    @property
    def strokes(self) -> bool:
        """Whether lines are painted."""
        nil = _is_nil(self.style["stroke-opacity"]) or _is_nil(self.style["stroke-width"])
        return _is_painted(self.style["stroke"]) and not nil

    @property
    def even_odd(self) -> bool:
        """Whether what is enclosed twice is outside."""
        return self.style["fill-rule"] == "evenodd"


@lru_cache(1000)
def _is_painted(paint: str) -> bool:
    if paint == "none":
        return False
    color = tinycss2.color4.parse_color(paint)
    return color is None or color == "currentcolor" or bool(color.alpha > 0.0)


@lru_cache(1000)
def _is_white(paint: str) -> bool:
    color: Any = tinycss2.color4.parse_color(paint)
    return color not in (None, "currentcolor") and min(color.coordinates) > 0.99


@lru_cache(1000)
def _is_nil(amount: str) -> bool:
    try:
        return float(amount.strip().rstrip("%px")) <= 0.0
    except ValueError:
        return False


def import_svg(path: Path, options: ImportOptions) -> Map:
    """Return the map in an SVG drawing.

    All shapes that a browser shows are outlines or lines, whatever their colour. With ``wall_mm``
    shapes without fill are walls of that thickness, filled ones outlines. The lower left corner of
    the page is the map's origin.
    """
    drawing = _source(path, options, lines_only=False)
    return replace(drawing_map(path, drawing, options), environment="svg")


def svg_source(path: Path, options: ImportOptions) -> SourceDrawing:
    """Return the lines of an SVG drawing in the groups that are asked for, curves as curves.

    The background of the page is left out; lines without stroke are read too.
    """
    return _source(path, options, lines_only=True)


def _source(path: Path, options: ImportOptions, *, lines_only: bool) -> SourceDrawing:
    # What overflows in nested transforms is found, and named, by `drawing_map`.
    with located(path), np.errstate(over="ignore", invalid="ignore"):
        root = read_nodes(path)
        cascade(root)
        try:
            return _drawing(root, options, lines_only=lines_only)
        except RecursionError:  # elements that use others, each within many groups
            raise UnreadableFileError(path, "has elements nested too deep") from None


def _drawing(root: Node, options: ImportOptions, *, lines_only: bool) -> SourceDrawing:
    page = page_frame(root)
    walls, free = options.wall_mm is not None, options.drawn == "free"
    walk = _Walk(
        frozenset(options.layers),
        root=root,
        page=page.box,
        walls=walls,
        free=free,
        lines_only=lines_only,
    )
    stretch = np.array([[1.0, 0.0, 0.0], [0.0, page.stretch, 0.0]])
    items = walk.items(about(stretch, page.box[:2]))
    unknown = sorted(set(options.layers) - walk.names)
    if unknown:
        raise UnknownNameError("layer or group", unknown[0], walk.names)
    return SourceDrawing(
        items=tuple(items),
        unit=page.unit,
        down=True,
        layered=len(walk.drawn_in) > 1,
        origin=(float(page.box[0]), float(page.box[1] + page.stretch * page.box[3])),
        facts={
            **walk.facts(options.layers, "elements"),
            **({"page": _PAGE_IS_AREA} if walk.backgrounds and options.drawn is None else {}),
        },
    )


@dataclass(slots=True)
class _Walk(DrawingReader):
    """Traversal of the elements of a drawing."""

    root: Node = field(kw_only=True)
    page: Floats = field(kw_only=True)
    walls: bool = field(kw_only=True)
    free: bool = field(kw_only=True)
    lines_only: bool = field(kw_only=True)
    names: set[str] = field(default_factory=set)
    drawn_in: set[tuple[str, ...]] = field(default_factory=set)  # groups of the elements read
    by_id: dict[str, Node] = field(default_factory=dict)
    backgrounds: list[DrawingItem] = field(default_factory=list)
    seen: int = 0

    def items(self, matrix: Floats) -> list[DrawingItem]:
        for node in self.root.nodes():
            self.by_id.setdefault(node.get("id", ""), node)
        em = font_px(self.root, View())
        view = View(float(self.page[2]), float(self.page[3]), em, em)
        found = list(self._items(self.root, _Place(matrix, (), INHERITED, view)))
        self.backgrounds = self._page_backgrounds(found)
        rest = [item for item in found if not any(item is page for page in self.backgrounds)]
        if self.lines_only:
            return rest
        if self.backgrounds and self._is_enclosed(rest):
            self.ignored["background of the page"] += len(self.backgrounds)
            self.backgrounds.clear()
            return rest
        return found

    def _items(self, node: Node, place: _Place) -> Iterator[DrawingItem]:
        self.seen += 1
        if self._left_out(node, place):
            return
        place = self._inner(node, place)
        if node.tag == "switch":
            shown = next((one for one in node.children if _meets_conditions(one)), None)
            yield from () if shown is None else self._items(shown, place)
        elif node.tag in _GROUPS:
            for child in node.children:
                yield from self._items(child, place)
        elif node.tag == "use":
            yield from self._used(node, place)
        else:
            yield from self._drawn(node, place)

    def _left_out(self, node: Node, place: _Place) -> bool:
        """Return whether an element draws nothing; count it if it might be expected to."""
        if node.tag in _SILENT and not (node.tag == "symbol" and place.uses):
            return True
        style = node.style
        if node.tag not in _DRAWN:
            self.ignored[node.tag] += 1
        elif style.get("display") == "none":
            self.ignored["display:none"] += 1
        elif _is_nil(style.get("opacity", "1")):
            self.ignored["opacity 0"] += 1
        elif not _meets_conditions(node):
            self.ignored["of another language or program"] += 1
        else:
            for child in node.children:
                if child.tag in _ANIMATIONS and child.get("attributeName") not in _PAINT_ONLY:
                    remedy = "take it out, or export a still picture"
                    raise UnfitInputError(child.where, "an animation moves or hides shapes", remedy)
            return False
        return True

    def _inner(self, node: Node, place: _Place) -> _Place:
        style, view, clip = place.style, place.view, place.clip
        for name in INHERITED.keys() & node.style.keys():
            value = node.style[name].strip()
            if value not in ("inherit", "unset", "revert"):
                style = style | {name: INHERITED[name] if value == "initial" else value}
        if "font-size" in node.style:
            view = replace(view, font_px=font_px(node, view))
        matrix = self._moved(node, place.matrix, view)
        if node.tag in ("svg", "symbol") and node is not self.root:
            inner = viewport(node, view, place.size)
            if node.style.get("overflow", "hidden") not in ("visible", "auto") and inner.size[0]:
                x, y, width, height = inner.frame.tolist()
                corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
                clip = _both(clip, Polygon(_placed(np.array(corners), matrix)))
            matrix = after(matrix, inner.matrix)
            view = replace(view, width=inner.size[0], height=inner.size[1])
        layers = place.layers
        if node is not self.root and (node.tag in _GROUPS or node.tag == "use"):
            names = [node.attrib[key] for key in ("id", "label") if key in node.attrib]
            self.names.update(names)
            layers = (*layers, *names)
        inside = _Place(matrix, layers, style, view, clip, place.uses)
        for name in ("clip-path", "mask"):
            value = node.style.get(name, "none").strip()
            if value not in ("none", "initial", "unset"):
                region = self._region(node, name, value, inside)
                inside = replace(inside, clip=_both(inside.clip, region))
        return inside

    def _moved(self, node: Node, matrix: Floats, view: View) -> Floats:
        text = node.style.get("transform", "none").strip()
        if text in ("none", ""):
            return matrix
        own = transform(node, view)
        if node is self.root:
            remedy = "move the drawing in a group in it"
            raise UnfitInputError(node.where, "the whole page is transformed", remedy)
        origin, box = node.style.get("transform-origin"), None
        by_box = node.style.get("transform-box", "view-box") != "view-box"
        if not (origin or by_box):
            return after(matrix, own)
        if by_box:
            box = self._box(node, view, "transform-box")
        return after(matrix, about(own, transform_origin(node, view, box)))

    def _box(self, node: Node, view: View, why: str) -> Floats:
        """Return x, y, width and height of the bounding box of a shape, in its coordinates."""
        points = (
            [Ring(pieces=tuple(run.pieces)).flattened() for run in svg_outlines(node, view)]
            if node.tag in SHAPES
            else []
        )
        if not points:
            problem = f"{why} refers to the box of a {node.tag}"
            raise UnfitInputError(node.where, problem, "save as plain SVG, or ungroup it")
        low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
        return np.concatenate([low, high - low])

    def _target(self, node: Node, name: str) -> Node:
        target = self.by_id.get(name.removeprefix("#")) if name.startswith("#") else None
        if target is None:
            raise BadInputError(f"{node.where}: href", name, "the id of an element in the file")
        return target

    def _used(self, node: Node, place: _Place) -> Iterator[DrawingItem]:
        name = node.get("href", "")
        if _GLYPH.match(name):
            self.ignored["text"] += 1
            return
        target = self._target(node, name)
        if name in place.uses:
            raise BadInputError(node.where, "a use that contains itself", "uses of other elements")
        x, y = (length_px(node, key, place.view) for key in ("x", "y"))
        shift = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
        size = None
        if {"width", "height"} & set(node.style):
            given = (key if key in node.style else "" for key in ("width", "height"))
            size = tuple(
                length_px(node, key, place.view) if key else place.view.reference(other)
                for key, other in zip(given, ("width", "height"), strict=True)
            )
        matrix = after(place.matrix, shift)
        place = replace(place, matrix=matrix, uses=(*place.uses, name), size=size)  # type: ignore[arg-type]
        yield from self._items(target, place)

    # --- What is shown of a shape -----------------------------------------------------------------

    def _region(self, node: Node, name: str, value: str, place: _Place) -> BaseGeometry:
        """Return what a clip path or a mask shows, in user units of the page."""
        match = re.fullmatch(r"url\(\s*[\"']?#([^\"')]+)[\"']?\s*\)", value)
        target = self.by_id.get(match[1]) if match is not None else None
        if match is not None and target is None:
            return shapely.box(*(-1e15, -1e15, 1e15, 1e15))  # browsers pass a missing one over
        if target is None or target.tag not in ("clipPath", "mask"):
            remedy = "it may hide shapes: cut them in the drawing program, or take it out"
            raise UnfitInputError(node.where, f"{name} {value[:40]!r} is not read", remedy)
        if target.get("id", "") in place.uses:
            raise BadInputError(node.where, f"a {name} that contains itself", "others")
        matrix = self._moved(target, place.matrix, place.view)
        units = "clipPathUnits" if target.tag == "clipPath" else "maskContentUnits"
        view = place.view
        if target.get(units) == "objectBoundingBox":
            x, y, width, height = self._box(node, view, units).tolist()
            matrix = after(matrix, np.array([[width, 0.0, x], [0.0, height, y]]))
        uses = (*place.uses, target.get("id", ""))
        own = _Place(matrix, (), INHERITED, view, None, uses)
        parts = [part for child in target.children for part in self._parts(child, own, target)]
        area = shapely.union_all(parts) if parts else Polygon()
        nested = target.style.get("clip-path", "none").strip()
        if nested != "none":
            area = shapely.intersection(area, self._region(node, name, nested, own))
        return area

    def _parts(self, node: Node, place: _Place, region: Node) -> Iterator[BaseGeometry]:
        """Yield the areas of a part of a clip path or mask, in user units of the page."""
        if node.tag in _SILENT or node.style.get("display") == "none":
            return
        if node.tag not in SHAPES | {"use"} | ({"g"} if region.tag == "mask" else set()):
            problem = f"{region.tag} {region.get('id', '')!r} has a {node.tag} in it"
            raise UnfitInputError(node.where, problem, "cut the shapes in the drawing program")
        place = self._inner(node, place)
        if place.style["visibility"] != "visible":
            return
        if node.tag == "use":
            x, y = (length_px(node, key, place.view) for key in ("x", "y"))
            matrix = after(place.matrix, np.array([[1.0, 0.0, x], [0.0, 1.0, y]]))
            name = node.get("href", "")
            if name in place.uses:
                raise BadInputError(node.where, "a use that contains itself", "others")
            inner = replace(place, matrix=matrix, uses=(*place.uses, name))
            yield from self._parts(self._target(node, name), inner, region)
        elif node.tag == "g":
            for child in node.children:
                yield from self._parts(child, place, region)
        else:
            if region.tag == "mask" and not self._is_whole(place, region):
                problem = f"mask {region.get('id', '')!r} hides by degrees"
                raise UnfitInputError(node.where, problem, "cut the shapes, or take the mask out")
            rule = place.style["clip-rule" if region.tag == "clipPath" else "fill-rule"]
            runs = svg_outlines(node, place.view)
            area = _area(runs, place.matrix, even_odd=rule == "evenodd")
            yield area if place.clip is None else shapely.intersection(area, place.clip)

    @staticmethod
    def _is_whole(place: _Place, region: Node) -> bool:
        """Return whether what a shape of a mask covers is shown whole."""
        opaque = place.fills and place.style["fill-opacity"] in ("1", "100%")
        by_alpha = "alpha" in region.get("style", "") + region.get("mask-type", "")
        return opaque and not place.strokes and (by_alpha or _is_white(place.style["fill"]))

    def _drawn(self, node: Node, place: _Place) -> Iterator[DrawingItem]:
        if self.layers and not self.layers & set(place.layers):
            self.ignored["in other groups"] += 1
            return
        if place.style["visibility"] in ("hidden", "collapse"):
            self.ignored["hidden"] += 1
            return
        fills = place.fills and node.tag != "line"
        if not (fills or place.strokes or self.lines_only):
            self.ignored["neither fill nor stroke"] += 1
            return
        runs = svg_outlines(node, place.view)
        shown = [(run, tuple(moved(piece, place.matrix) for piece in run.pieces)) for run in runs]
        if fills and len(shown) > 1:
            keep = _bounding(
                [run_flat(pieces, math.inf) for _, pieces in shown], even_odd=place.even_odd
            )
            shown = [one for one, kept in zip(shown, keep, strict=True) if kept]
        own = [node.attrib[key] for key in ("id", "label") if key in node.attrib]
        width = 0.0
        if self.lines_only:
            stretch = math.sqrt(abs(float(np.linalg.det(place.matrix[:, :2]))))
            width = length_px(node, WIDTH_ATTRIBUTE, place.view) * stretch
        found = []
        for run, pieces in shown:
            ring = Ring(pieces=pieces)
            # A fill closes an open path with a straight line.
            area = fills and len(ring.hull()) > 2
            item = DrawingItem(
                rings=(ring,),
                where=node.where,
                closed=run.closed or area,
                role="obstacle" if self.walls and area else None,
                paint=self.seen if area else None,
                even_odd=place.even_odd,
                names=(*place.layers, *own),
                width=width or None,
                unjoined=not run.closed,
                bare=area and not place.strokes,
            )
            found.append(item)
        if found and place.clip is not None:
            whole = [_hull_box(item) for item in found]
            if not all(shapely.contains(place.clip, box) for box in whole):
                found = _clipped(found, place.clip, runs, place)
        if found or place.clip is None:
            self.read[node.tag] += 1
            self.drawn_in.add(place.layers)
        else:
            self.ignored["clipped away"] += 1
        yield from found

    # --- Backgrounds ------------------------------------------------------------------------------

    def _page_backgrounds(self, items: Sequence[DrawingItem]) -> list[DrawingItem]:
        """Return what is painted first, covers nearly all of the page and holds everything else."""
        least_share, found = 0.9, list[DrawingItem]()
        page_area = float(self.page[2] * self.page[3])
        for index, item in enumerate(items):
            if item.bare and item.rings[0].is_rectangle() and page_area > 0.0:
                low, high = _extent([item])
                covers = float(np.prod(high - low)) >= least_share * page_area
                exact = self._is_page(low, high)
                if exact or (covers and len(found) == index and _holds(low, high, items)):
                    found.append(item)
        return found

    def _is_page(self, low: Floats, high: Floats) -> bool:
        corner, size = self.page[:2], self.page[2:]
        page_slack = 5e-5  # of the page's larger side: programs round the corners of its background
        off = max(np.abs(low - corner).max(), np.abs(high - corner - size).max())
        return bool(off <= page_slack * size.max())

    def _is_enclosed(self, rest: list[DrawingItem]) -> bool:
        """Return whether one of the other shapes is the bounds of them, or areas are free."""
        if not rest:
            return False
        if self.free and any(item.paint is not None for item in rest):
            return True
        low, high = _extent(rest)
        return len(rest) > 1 and any(_holds(*_extent([item]), [], low, high) for item in rest)


def _extent(items: Sequence[DrawingItem]) -> tuple[Floats, Floats]:
    hulls = np.concatenate([item.rings[0].hull() for item in items])
    return hulls.min(axis=0), hulls.max(axis=0)


def _holds(
    low: Floats,
    high: Floats,
    items: Sequence[DrawingItem],
    least: Floats | None = None,
    most: Floats | None = None,
) -> bool:
    """Return whether a box contains all items, or another box."""
    if least is None or most is None:
        least, most = _extent(items)
    slack = 1e-9 * float((high - low).max())
    return bool((low <= least + slack).all() and (high >= most - slack).all())


def _meets_conditions(node: Node) -> bool:
    """Return whether a browser in English shows an element that has conditions."""
    languages = node.get("systemLanguage")
    english = languages is None or any(
        one.strip().lower().startswith("en") for one in languages.split(",")
    )
    return english and not node.get("requiredExtensions", "")


def _both(one: BaseGeometry | None, other: BaseGeometry) -> BaseGeometry:
    return other if one is None else shapely.intersection(one, other)


def _placed(points: Floats, matrix: Floats) -> Floats:
    return np.asarray(points @ matrix[:, :2].T + matrix[:, 2])


def _bounding(rings: list[Floats], *, even_odd: bool) -> list[bool]:
    """Return which rings of one fill bound it: by the nonzero rule one in another may not."""
    keep = [True] * len(rings)
    if even_odd or any(len(ring) < 3 for ring in rings):
        return keep
    polygons = np.array([Polygon(ring) for ring in rings], dtype=np.object_)
    if not shapely.is_valid(polygons).all():
        return keep
    signs = np.where(shapely.is_ccw(shapely.get_exterior_ring(polygons)), 1, -1)
    around, inside = shapely.STRtree(polygons).query(polygons, predicate="contains_properly")
    outer = np.bincount(inside, weights=signs[around], minlength=len(rings))
    return list(((outer == 0) != (outer + signs == 0)).tolist())


def _area(runs: Sequence[Subpath], matrix: Floats, *, even_odd: bool) -> BaseGeometry:
    """Return the area that subpaths enclose, moved."""
    points = [_placed(Ring(pieces=tuple(run.pieces)).flattened(), matrix) for run in runs]
    points = [ring for ring in points if len(ring) >= 3]
    keep = _bounding(points, even_odd=even_odd)
    area: BaseGeometry = Polygon()
    for ring, kept in zip(points, keep, strict=True):
        if not kept:
            continue
        own: BaseGeometry = Polygon(ring)
        if not own.is_valid:
            own = shapely.make_valid(own, method="linework" if even_odd else "structure")
        apart = shapely.contains(area, own) or shapely.disjoint(area, own)
        area = (area ^ own) if even_odd or apart else (area | own)
    return area


def _hull_box(item: DrawingItem) -> BaseGeometry:
    low, high = _extent([item])
    return shapely.box(*low, *high)


def _clipped(
    items: list[DrawingItem], clip: BaseGeometry, runs: Sequence[Subpath], place: _Place
) -> list[DrawingItem]:
    """Return the parts of a shape's items that a clip shows."""
    found = []
    lines = [item for item in items if item.paint is None]
    areas = [item for item in items if item.paint is not None]
    if areas:
        shown = shapely.intersection(_area(runs, place.matrix, even_odd=place.even_odd), clip)
        rings = (
            ring
            for part in shapely.get_parts(shown)
            if isinstance(part, Polygon) and not part.is_empty
            for ring in (part.exterior, *part.interiors)
        )
        for ring in rings:
            outline = Straight(np.asarray(ring.coords)[:-1])
            found.append(replace(areas[0], rings=(Ring(pieces=(outline,)),), closed=True))
    for item in lines:
        points = item.rings[0].flattened()
        points = np.vstack([points, points[:1]]) if item.closed else points
        if shapely.contains(clip, shapely.LineString(points)):
            found.append(item)
            continue
        shown = shapely.line_merge(shapely.intersection(shapely.LineString(points), clip))
        for part in shapely.get_parts(shown):
            if part.length > 0.0:
                line = Ring(pieces=(Straight(np.asarray(part.coords)),))
                found.append(replace(item, rings=(line,), closed=False))
    return found
