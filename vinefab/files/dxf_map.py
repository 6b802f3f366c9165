"""DXF drawings, R12 to R2018: layers, blocks and units; the entities are `dxf_entities`."""

import io
import logging
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ezdxf import recover
from ezdxf.audit import AuditError
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.entities.insert import Insert
from ezdxf.filemanagement import readfile
from ezdxf.lldxf.const import DXFError

from vinefab.core.errors import BadInputError, UnknownNameError, UnreadableFileError
from vinefab.files.drawing import Drawing, ImportOptions, Item, drawing_map
from vinefab.files.dxf_entities import FLAT, READERS, items_of
from vinefab.files.shipped import read_bytes
from vinefab.model.map import Map

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document

_LARGEST_BYTES = 512 << 20
_MOST_ENTITIES = 500_000
_DEEPEST_BLOCK = 16
_MM = {
    1: ("inches", 25.4),
    2: ("feet", 304.8),
    3: ("miles", 1_609_344.0),
    4: ("mm", 1.0),
    5: ("cm", 10.0),
    6: ("m", 1000.0),
    7: ("km", 1e6),
    8: ("microinches", 25.4e-6),
    9: ("mils", 25.4e-3),
    10: ("yards", 914.4),
    13: ("micrometres", 1e-3),
    14: ("dm", 100.0),
    15: ("decametres", 1e4),
    16: ("hectometres", 1e5),
    21: ("US survey feet", 1_200_000.0 / 3937.0),
    22: ("US survey inches", 100_000.0 / 3937.0),
    23: ("US survey yards", 3_600_000.0 / 3937.0),
    24: ("US survey miles", 6_336_000_000.0 / 3937.0),
}
_SOLIDS = {"3DSOLID", "BODY", "MESH", "REGION", "SURFACE"}
_BROKEN = (
    DXFError,
    ValueError,
    KeyError,
    IndexError,
    TypeError,
    AttributeError,
    ArithmeticError,
    RecursionError,
    StopIteration,
)
"""What ezdxf raises on files that are broken in ways that it does not expect."""


_GUESSED = (AuditError.INVALID_INTEGER_VALUE, AuditError.INVALID_FLOATING_POINT_VALUE)
_UNHEARD = logging.NullHandler()


def import_dxf(path: Path, options: ImportOptions) -> Map:
    """Return the map in a DXF drawing.

    Hatches and solids are areas, everything else lines and outlines. Blocks are taken apart.
    What is frozen, off, invisible, text or not in model space is counted and left out.

    Raises
    ------
    UnreadableFileError
        If it cannot be read or is not DXF.
    BadInputError, UnknownNameError
        For the first entity that is wrong, an unknown layer, or what `drawing_map` refuses.
    """
    document, mended = _document(path)
    try:
        drawing = _drawing(document, options.layers)
    except BadInputError as error:
        raise error.at(path) from error
    except UnknownNameError:
        raise
    except _BROKEN as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise UnreadableFileError(path, f"is a damaged DXF file: {problem[:120]}") from error
    if mended:
        drawing = replace(drawing, facts={**drawing.facts, "faults_mended_by_reader": mended})
    return replace(drawing_map(path, drawing, options), environment="dxf")


def _document(path: Path) -> tuple["Document", int]:
    """Return the document and how many faults in it were mended by the reader."""
    data = read_bytes(path, _LARGEST_BYTES)
    if not data.strip():
        raise UnreadableFileError(path, "is empty")
    # The reader's warnings go into the one line that the user gets, not beside it.
    logging.getLogger("ezdxf").addHandler(_UNHEARD)
    try:
        document, mended = readfile(path), 0
    except (OSError, *_BROKEN):
        document, mended = _recovered(path, data)
    if b"$INSUNITS" not in data:
        # ezdxf takes metres then; the file says nothing.
        document.header["$INSUNITS"] = 0
    return document, mended


def _recovered(path: Path, data: bytes) -> tuple["Document", int]:
    """Return a damaged document, if nothing but its structure had to be mended."""
    try:
        document, auditor = recover.read(io.BytesIO(data))
    except (OSError, *_BROKEN) as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise UnreadableFileError(path, f"is not a DXF file: {problem[:120]}") from error
    for fix in (*auditor.fixes, *auditor.errors):
        if fix.code in _GUESSED:
            raise UnreadableFileError(path, f"is a damaged DXF file: {fix.message}")
    return document, len(auditor.fixes)


def _drawing(document: "Document", layers: tuple[str, ...]) -> Drawing:
    known = {layer.dxf.name for layer in document.layers}
    space = list(document.modelspace())
    known |= {_layer(entity) for entity in space}
    by_key = {name.lower(): name for name in known}
    for name in layers:
        if name.lower() not in by_key:
            raise UnknownNameError("layer", name, known)
    walk = _Walk(document, frozenset(name.lower() for name in layers))
    items = walk.items(space)
    code = int(document.header.get("$INSUNITS", 0))
    unit, mm_per_unit = _MM.get(code, ("mm (taken; the file names none)", 1.0))
    return Drawing(
        items=tuple(items),
        mm_per_unit=mm_per_unit,
        facts={
            "dxf_version": document.acad_release,
            "units": unit,
            **({"layers": sorted(layers)} if layers else {}),
            "entities": dict(walk.read),
            **({"ignored": dict(walk.ignored)} if walk.ignored else {}),
        },
    )


def _layer(entity: DXFGraphic) -> str:
    """Return an entity's layer; entities of unknown types have none."""
    return str(entity.dxf.layer) if entity.dxf.hasattr("layer") else "0"


@dataclass(slots=True)
class _Walk:
    """A walk through model space and the blocks inserted in it."""

    document: "Document"
    layers: frozenset[str]
    read: Counter[str] = field(default_factory=Counter)
    ignored: Counter[str] = field(default_factory=Counter)
    seen: int = 0

    def items(self, space: Iterable[DXFGraphic]) -> list[Item]:
        found: list[Item] = []
        for entity, layer, where in self._leaves(space, None, "", 0):
            kind = entity.dxftype()
            hidden = self._hidden(entity, layer)
            if hidden is not None:
                self.ignored[hidden] += 1
            elif kind in _SOLIDS or kind.endswith("SURFACE"):
                raise BadInputError(where, "a solid or surface", FLAT)
            elif kind not in READERS:
                self.ignored[kind] += 1
            else:
                found += items_of(entity, where)
                self.read[kind] += 1
        return found

    def _hidden(self, entity: DXFGraphic, layer: str) -> str | None:
        """Return why an entity is not drawn, None when it is."""
        if self.layers and layer.lower() not in self.layers:
            return "on other layers"
        if entity.dxf.hasattr("invisible") and entity.dxf.invisible:
            return "invisible"
        if layer in self.document.layers:
            state = self.document.layers.get(layer)
            if state.is_frozen() or state.is_off():
                return f"on layer {layer}, which is {'frozen' if state.is_frozen() else 'off'}"
        return None

    def _leaves(
        self, space: Iterable[DXFGraphic], outer: str | None, inside: str, depth: int
    ) -> Iterator[tuple[DXFGraphic, str, str]]:
        """Yield entities that are no blocks, with their layer and what messages call them."""
        for entity in space:
            self.seen += 1
            if self.seen > _MOST_ENTITIES:
                raise BadInputError(
                    "entities", f"more than {_MOST_ENTITIES}", "fewer, in blocks too"
                )
            kind, layer = entity.dxftype(), _layer(entity)
            # Layer 0 in a block means the layer on which the block is inserted.
            layer = outer if outer is not None and layer == "0" else layer
            where = f"{kind} {inside}" if inside else f"{kind} (handle {entity.dxf.handle})"
            if isinstance(entity, Insert):
                yield from self._of_block(entity, layer, inside, depth)
            elif kind == "MLINE":
                parts = entity.virtual_entities()  # type: ignore[attr-defined]
                yield from ((part, layer, where) for part in parts)
            else:
                yield entity, layer, where

    def _of_block(
        self, insert: Insert, layer: str, inside: str, depth: int
    ) -> Iterator[tuple[DXFGraphic, str, str]]:
        name = insert.dxf.name
        inside = inside or f"in block {name} (INSERT handle {insert.dxf.handle})"
        if depth >= _DEEPEST_BLOCK:
            raise BadInputError(inside, f"blocks {depth} deep", f"at most {_DEEPEST_BLOCK}")
        if insert.block() is None:
            self.ignored[f"INSERT of the missing block {name}"] += 1
            return
        if insert.mcount > _MOST_ENTITIES:
            raise BadInputError(inside, f"{insert.mcount} copies", f"at most {_MOST_ENTITIES}")
        if layer in self.document.layers and self.document.layers.get(layer).is_frozen():
            self.ignored[f"on layer {layer}, which is frozen"] += 1
            return
        for single in insert.multi_insert() if insert.mcount > 1 else [insert]:
            parts = single.virtual_entities(skipped_entity_callback=self._skipped)
            yield from self._leaves(parts, layer, inside, depth + 1)

    def _skipped(self, entity: DXFGraphic, reason: str) -> None:
        if entity.dxftype() in READERS:
            where = f"{entity.dxftype()} (handle {entity.dxf.handle}) in a block"
            raise BadInputError(where, reason, "blocks that can be taken apart; explode it first")
        self.ignored[entity.dxftype()] += 1
