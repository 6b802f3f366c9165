"""SVG drawings: groups, uses, styles and units; the shapes are `svg_path`."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.environments.curves import Straight
from vinefab.files.drawing import Drawing, ImportOptions, Item, Ring, drawing_map
from vinefab.files.svg_document import Node, read_nodes
from vinefab.files.svg_frame import (
    IDENTITY,
    after,
    length_px,
    numbers,
    page,
    transform,
    viewport,
)
from vinefab.files.svg_path import Subpath, ellipse, moved, path_outlines, rectangle
from vinefab.model.checked import Floats
from vinefab.model.map import Map

_GROUPS = {"svg", "g", "a", "switch", "symbol"}
_SHAPES = {"path", "rect", "circle", "ellipse", "line", "polyline", "polygon"}
_DRAWN = _GROUPS | _SHAPES | {"use"}
_SILENT = {
    "defs", "title", "desc", "metadata", "style", "script", "namedview", "clipPath", "mask",
    "marker", "pattern", "linearGradient", "radialGradient", "filter", "symbol",
}  # fmt: skip
_MOST_ELEMENTS = 500_000
_DEEPEST_USE = 32
_RULE = re.compile(r"([^{}]+)\{([^{}]*)\}")


@dataclass(frozen=True, slots=True)
class _Place:
    """Where in the tree an element stands."""

    matrix: Floats
    layers: tuple[str, ...]
    filled: bool
    uses: int = 0


def import_svg(path: Path, options: ImportOptions) -> Map:
    """Return the map in an SVG drawing.

    All shapes are outlines or lines, whatever their colour. With ``wall_mm`` shapes without fill
    are walls of that thickness, those with a fill outlines. The lower left corner of the page is
    the map's origin.

    Raises
    ------
    UnreadableFileError
        If it cannot be read or is not SVG.
    BadInputError, UnknownNameError
        For the first element that is wrong, an unknown group, or what `drawing_map` refuses.
    """
    root = read_nodes(path)
    try:
        drawing = _drawing(root, options)
    except BadInputError as error:
        raise error.at(path) from error
    return replace(drawing_map(path, drawing, options), environment="svg")


def _drawing(root: Node, options: ImportOptions) -> Drawing:
    box, mm_per_unit, units = page(root)
    walk = _Walk(root, frozenset(options.layers), box, walls=options.wall_mm is not None)
    items = walk.items()
    unknown = sorted(set(options.layers) - walk.names)
    if unknown:
        raise UnknownNameError("layer or group", unknown[0], walk.names)
    return Drawing(
        items=tuple(items),
        mm_per_unit=mm_per_unit,
        down=True,
        origin=(float(box[0]), float(box[1] + box[3])),
        facts={
            "units": units,
            **({"layers": sorted(options.layers)} if options.layers else {}),
            "elements": dict(walk.read),
            **({"ignored": dict(walk.ignored)} if walk.ignored else {}),
        },
    )


@dataclass(slots=True)
class _Walk:
    """A walk through the elements of a drawing."""

    root: Node
    layers: frozenset[str]
    page: Floats
    walls: bool = field(kw_only=True)
    read: Counter[str] = field(default_factory=Counter)
    ignored: Counter[str] = field(default_factory=Counter)
    names: set[str] = field(default_factory=set)
    by_id: dict[str, Node] = field(default_factory=dict)
    styles: dict[str, dict[str, str]] = field(default_factory=dict)
    backgrounds: list[Item] = field(default_factory=list)
    seen: int = 0

    def items(self) -> list[Item]:
        for node in _all(self.root):
            self.by_id.setdefault(node.attributes.get("id", ""), node)
            if node.tag == "style":
                self.styles |= _rules(node.text)
        place = _Place(IDENTITY, (), filled=True)
        found = [item for node in self.root.children for item in self._items(node, place)]
        return self._without_backgrounds(found)

    def _items(self, node: Node, place: _Place) -> Iterator[Item]:
        self.seen += 1
        if self.seen > _MOST_ELEMENTS:
            raise BadInputError("elements", f"more than {_MOST_ELEMENTS}", "fewer, in uses too")
        style = self._style(node)
        if self._left_out(node, style, place):
            return
        place = self._inner(node, style, place)
        if node.tag in _GROUPS:
            for child in node.children:
                yield from self._items(child, place)
        elif node.tag == "use":
            yield from self._used(node, place)
        else:
            yield from self._drawn(node, style, place)

    def _left_out(self, node: Node, style: dict[str, str], place: _Place) -> bool:
        """Tell whether an element draws nothing; count it if one might think that it does."""
        if node.tag in _SILENT and not (node.tag == "symbol" and place.uses):
            return True
        if node.tag not in _DRAWN:
            self.ignored[node.tag] += 1
        elif style.get("display") == "none":
            self.ignored["display:none"] += 1
        else:
            if style.get("clip-path", "none") != "none":
                self.ignored["clip-path"] += 1
            return False
        return True

    def _style(self, node: Node) -> dict[str, str]:
        """Return an element's own properties: attributes, then style sheets, then its style."""
        attributes = node.attributes
        names = [node.tag, *(f".{name}" for name in attributes.get("class", "").split())]
        found = dict(attributes)
        for name in [*names, f"#{attributes.get('id', '')}"]:
            found |= self.styles.get(name, {})
        return found | _declarations(attributes.get("style", ""))

    def _inner(self, node: Node, style: dict[str, str], place: _Place) -> _Place:
        matrix = after(place.matrix, transform(node))
        if node.tag in ("svg", "symbol"):
            matrix = after(matrix, viewport(node))
        layers = place.layers
        if node.tag in _GROUPS or node.tag == "use":
            names = [node.attributes[key] for key in ("id", "label") if key in node.attributes]
            self.names.update(names)
            layers = (*layers, *names)
        fill = style.get("fill", "inherit").strip()
        filled = place.filled if fill == "inherit" else fill not in ("none", "transparent")
        return _Place(matrix, layers, filled, place.uses)

    def _used(self, node: Node, place: _Place) -> Iterator[Item]:
        name = node.attributes.get("href", "")
        target = self.by_id.get(name.removeprefix("#")) if name.startswith("#") else None
        if target is None:
            raise BadInputError(f"{node.where}: href", name, "the id of an element in the file")
        if place.uses >= _DEEPEST_USE:
            raise BadInputError(node.where, "uses of uses without end", f"{_DEEPEST_USE} at most")
        shift = np.array([[1.0, 0.0, length_px(node, "x")], [0.0, 1.0, length_px(node, "y")]])
        place = replace(place, matrix=after(place.matrix, shift), uses=place.uses + 1)
        if target.tag in ("symbol", "svg"):
            size = {k: v for k, v in node.attributes.items() if k in ("width", "height")}
            target = replace(target, attributes=target.attributes | size)
        yield from self._items(target, place)

    def _drawn(self, node: Node, style: dict[str, str], place: _Place) -> Iterator[Item]:
        if self.layers and not self.layers & set(place.layers):
            self.ignored["in other groups"] += 1
            return
        if style.get("visibility") in ("hidden", "collapse"):
            self.ignored["hidden"] += 1
            return
        self.read[node.tag] += 1
        for run in _outlines(node):
            pieces = tuple(moved(piece, place.matrix) for piece in run.pieces)
            ring = Ring(pieces=pieces)
            # Painting fills a path up to the straight line that would close it.
            fills = place.filled and len(ring.hull()) > 2
            item = Item(
                rings=(ring,),
                where=node.where,
                closed=run.closed or fills,
                role="obstacle" if self.walls and fills else None,
            )
            if fills and style.get("stroke", "none") == "none" and self._is_page(ring):
                self.backgrounds.append(item)
            yield item

    def _without_backgrounds(self, items: list[Item]) -> list[Item]:
        """Return items without the paper they lie on, if one of them encloses others anyway."""
        rest = [item for item in items if not any(item is paper for paper in self.backgrounds)]
        if not self.backgrounds or len(rest) < 2:
            return items
        hulls = [item.rings[0].hull() for item in rest]
        low = np.array([hull.min(axis=0) for hull in hulls])
        high = np.array([hull.max(axis=0) for hull in hulls])
        around = (low <= low.min(axis=0)).all(axis=1) & (high >= high.max(axis=0)).all(axis=1)
        if not around.any():
            return items
        self.ignored["background of the page"] += len(self.backgrounds)
        return rest

    def _is_page(self, ring: Ring) -> bool:
        """Tell whether an outline is the rectangle of the page."""
        points = np.unique(ring.hull(), axis=0)
        if len(points) != 4:
            return False
        corner, size = self.page[:2], self.page[2:]
        slack = 1e-6 * float(size.max())
        low = np.abs(points.min(axis=0) - corner).max()
        high = np.abs(points.max(axis=0) - corner - size).max()
        return bool(size.min() > 0.0 and low <= slack and high <= slack)


def _outlines(node: Node) -> list[Subpath]:
    """Return what a shape draws, in its own coordinates."""
    try:
        if node.tag == "path":
            return path_outlines(node.attributes.get("d", ""))
    except BadInputError as error:
        raise BadInputError(f"{node.where}: {error.key}", error.value, error.allowed) from error
    if node.tag in ("polyline", "polygon"):
        values = numbers(node, "points")
        if len(values) % 2:
            raise BadInputError(f"{node.where}: points", f"{len(values)} numbers", "x,y pairs")
        points = np.array(values).reshape(-1, 2)
        run = Subpath([Straight(points)], closed=node.tag == "polygon")
        return [run] if len(points) >= 2 else []
    return _simple(node)


def _simple(node: Node) -> list[Subpath]:
    names = ("x", "y", "width", "height", "rx", "ry", "r", "cx", "cy", "x1", "y1", "x2", "y2")
    at = {name: length_px(node, name) for name in names}
    for name in ("width", "height", "rx", "ry", "r"):
        if at[name] < 0.0:
            raise BadInputError(f"{node.where}: {name}", at[name], "at least 0")
    if node.tag == "line":
        return [Subpath([Straight(np.array([[at["x1"], at["y1"]], [at["x2"], at["y2"]]]))])]
    rx, ry = (at[name] or at[other] for name, other in (("rx", "ry"), ("ry", "rx")))
    if node.tag == "rect":
        size = (at["width"], at["height"])
        return [rectangle(at["x"], at["y"], size, (rx, ry))] if min(size) > 0.0 else []
    radii = (at["r"], at["r"]) if node.tag == "circle" else (at["rx"], at["ry"])
    return [ellipse(at["cx"], at["cy"], radii)] if min(radii) > 0.0 else []


def _all(root: Node) -> Iterator[Node]:
    stack = [root]
    while stack:
        node = stack.pop()
        yield node
        stack += reversed(node.children)


def _rules(sheet: str) -> dict[str, dict[str, str]]:
    """Return the declarations of a style sheet's simple selectors: tag, .class and #id."""
    found: dict[str, dict[str, str]] = {}
    for selectors, body in _RULE.findall(re.sub(r"/\*.*?\*/", "", sheet, flags=re.DOTALL)):
        for selector in selectors.split(","):
            found.setdefault(selector.strip(), {}).update(_declarations(body))
    return found


def _declarations(text: str) -> dict[str, str]:
    pairs = (part.partition(":") for part in text.split(";"))
    return {name.strip(): value.strip() for name, colon, value in pairs if colon}
