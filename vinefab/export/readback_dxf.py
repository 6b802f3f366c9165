"""Reading a DXF file of ours again."""

import io
from collections import Counter
from pathlib import Path

import numpy as np
from ezdxf.document import Drawing as DxfDocument
from ezdxf.entities.lwpolyline import LWPolyline
from ezdxf.entities.polyline import Polyline
from ezdxf.filemanagement import read
from ezdxf.lldxf.const import DXFError

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.export.drawing import Drawing, DrawnPath, Format
from vinefab.export.dxf import AC1009, METRIC, MILLIMETRES
from vinefab.model.outline import Contour, Part


def read_dxf(source: Path | str) -> Drawing:
    """Return what a DXF file says.

    Parameters
    ----------
    source
        A path, or the text itself when it is a string.

    Raises
    ------
    UnreadableFileError
        If it is missing, not DXF, or holds numbers that are not finite.
    """
    name = str(source) if isinstance(source, Path) else "DXF text"
    try:
        text = source.read_text("utf-8") if isinstance(source, Path) else source
        document = read(io.StringIO(text))
        return _drawing(document)
    except (DXFError, BadInputError, UnicodeDecodeError) as error:
        raise UnreadableFileError(name, f"not a DXF file of ours: {error}") from error
    except OSError as error:
        raise UnreadableFileError(name, error.strerror or str(error)) from error


def _drawing(document: DxfDocument) -> Drawing:
    entities = list(document.modelspace())
    own = Polyline if document.dxfversion == AC1009 else LWPolyline
    polylines = [entity for entity in entities if isinstance(entity, own)]
    limit = document.header.get("$LIMMAX", (0.0, 0.0))
    return Drawing(
        format=Format.DXF,
        unit=_unit(document),
        sheet=(float(limit[0]), float(limit[1])),
        paths=tuple(_path(polyline) for polyline in polylines),
        layer_colours={layer.dxf.name: str(layer.dxf.color) for layer in document.layers},
        oddities=tuple(
            f"{count} entities of kind {kind}"
            for kind, count in Counter(entity.dxftype() for entity in entities).items()
            if kind != own.DXFTYPE
        ),
    )


def _unit(document: DxfDocument) -> str:
    if document.dxfversion == AC1009:
        return "mm"  # the only one that we write; the format has no place to say so
    said = document.header.get("$INSUNITS", 0), document.header.get("$MEASUREMENT", 0)
    if said == (MILLIMETRES, METRIC):
        return "mm"
    return f"$INSUNITS {said[0]} with $MEASUREMENT {said[1]}"


def _path(polyline: LWPolyline | Polyline) -> DrawnPath:
    if isinstance(polyline, Polyline):
        rows = [(*v.dxf.location.vec2, v.dxf.get("bulge", 0.0)) for v in polyline.vertices]
        points, closed = np.array(rows, dtype=np.float64), bool(polyline.is_closed)
    else:
        points, closed = np.array(polyline.get_points("xyb")), bool(polyline.closed)
    points = points.reshape(-1, 3)
    count = len(points) if closed else len(points) - 1
    return DrawnPath(
        layer=polyline.dxf.layer,
        colour=str(polyline.dxf.color),
        contour=Contour(
            points_mm=points[:, :2],
            bulges=points[: max(count, 0), 2],
            parts=(Part.OTHER,) * count,
            branches=("",) * count,
            closed=closed,
        ),
    )
