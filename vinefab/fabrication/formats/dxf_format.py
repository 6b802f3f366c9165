"""DXF: true arcs, chords for programs without arcs, and release 12 for old ones."""

import io
import logging
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from ezdxf import options  # type: ignore[attr-defined]
from ezdxf.document import Drawing as DxfDocument
from ezdxf.entities.lwpolyline import LWPolyline
from ezdxf.entities.polyline import Polyline
from ezdxf.filemanagement import new, read
from ezdxf.lldxf.const import DXFError

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.plain_text import GENERATOR, counted
from vinefab.fabrication.formats.laser_drawing import (
    DEFAULT,
    Colours,
    DrawnPath,
    LaserFormat,
    ReadDrawing,
    Style,
    StyledPath,
    flattened_contour,
    metadata,
    styled_paths,
)
from vinefab.model.job import Job
from vinefab.model.outline import FLATTEN_MM, Contour, Part

_TOLERANCE_MM = 1e-6

VERSION = "R2010"
RELEASE_12 = "R12"
AC1009 = "AC1009"
"""What a file of release 12 calls its version."""

MILLIMETRES = 4
METRIC = 1

_EZDXF_LOG = logging.getLogger("ezdxf")


def dxf_text(
    job: Job, colours: Colours = DEFAULT, *, polyline: bool = False, r12: bool = False
) -> str:
    """Return a job as the text of a DXF file, to be encoded as UTF-8.

    Every path is one LWPOLYLINE; arcs are bulges with exactly the radius of the model. Layer and
    entity both carry the colour, since some programs read the one and some the other. There are no
    texts, splines, blocks or hatches.
    """
    with fixed_metadata():
        document = new(RELEASE_12) if r12 else new(VERSION, units=MILLIMETRES)
        document.header["$MEASUREMENT"] = METRIC
        for key, value in metadata(job, colours).items():
            document.header.custom_vars.append(key, value)
        space = document.modelspace()
        space.reset_limits((0.0, 0.0), (job.sheet_width_mm, job.sheet_height_mm))
        paths = styled_paths(job, colours)
        boxes = np.array([styled.path.contour.box_mm for styled in paths])
        if len(boxes):
            low, high = boxes[:, :2].min(axis=0).tolist(), boxes[:, 2:].max(axis=0).tolist()
            space.reset_extents((*low, 0.0), (*high, 0.0))
        for styled in paths:
            _add(document, styled, polyline=polyline)
        if document.dxfversion != AC1009:
            for name in sorted(document.entitydb.dxf_types_in_use()):
                document.classes.add_class(name)
        stream = io.StringIO()
        document.write(stream)
    # Group 999 is a comment; at the top every reader skips it, and people see it first.
    return f"999\n{GENERATOR}\n{stream.getvalue()}"


def _add(document: DxfDocument, styled: StyledPath, *, polyline: bool) -> None:
    style = styled.style
    if style.layer not in document.layers:
        document.layers.add(style.layer, color=style.aci)
    contour = styled.path.contour
    if polyline:
        contour = flattened_contour(contour)
    bulges = contour.bulges.tolist()
    if not contour.closed:
        bulges.append(0.0)
    points = contour.points_mm.tolist()
    space = document.modelspace()
    # LWPOLYLINE came after release 12.
    add = space.add_polyline2d if document.dxfversion == AC1009 else space.add_lwpolyline
    add(
        [(x, y, bulge) for (x, y), bulge in zip(points, bulges, strict=True)],
        format="xyb",
        close=contour.closed,
        dxfattribs={"layer": style.layer, "color": style.aci},
    )


@contextmanager
def fixed_metadata() -> Iterator[None]:
    """Keep the clock and random identifiers out of the file; ezdxf has only a global switch.

    It also warns that every file of release 12 has no unit, which the format cannot have.
    """
    before, level = options.write_fixed_meta_data_for_testing, _EZDXF_LOG.level
    options.write_fixed_meta_data_for_testing = True
    _EZDXF_LOG.setLevel(logging.ERROR)
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before
        _EZDXF_LOG.setLevel(level)


def read_dxf(text: str) -> ReadDrawing:
    """Read a DXF file of ours."""
    try:
        document = read(io.StringIO(text))
        entities = list(document.modelspace())
        own = Polyline if document.dxfversion == AC1009 else LWPolyline
        polylines = [entity for entity in entities if isinstance(entity, own)]
        limit = document.header.get("$LIMMAX", (0.0, 0.0))
        unit = "mm"  # the only one that is written; release 12 cannot state it
        found = tuple(document.header.get(f"${name}", 0) for name in ("INSUNITS", "MEASUREMENT"))
        if document.dxfversion != AC1009 and found != (MILLIMETRES, METRIC):
            unit = "$INSUNITS {} with $MEASUREMENT {}".format(*found)
        return ReadDrawing(
            unit=unit,
            sheet=(float(limit[0]), float(limit[1])),
            paths=tuple(_path(polyline) for polyline in polylines),
            layer_colours={layer.dxf.name: str(layer.dxf.color) for layer in document.layers},
            oddities=tuple(
                f"{counted(count, 'entity')} of kind {kind}"
                for kind, count in Counter(entity.dxftype() for entity in entities).items()
                if kind != own.DXFTYPE
            ),
        )
    except (DXFError, BadInputError) as error:
        raise UnreadableFileError("DXF text", f"not a DXF file of ours: {error}") from None


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


def _colour_index(style: Style) -> str:
    return str(style.aci)


DXF = LaserFormat(
    title="DXF with true arcs",
    suffix=".dxf",
    write=lambda spec: dxf_text(spec.job, spec.colours),
    read=read_dxf,
    tolerance_mm=_TOLERANCE_MM,
    colour=_colour_index,
)
DXF_POLYLINE = LaserFormat(
    title="DXF with chords for arcs",
    use="for programs that lose arcs",
    suffix="_polyline.dxf",
    write=lambda spec: dxf_text(spec.job, spec.colours, polyline=True),
    read=read_dxf,
    tolerance_mm=_TOLERANCE_MM,
    contour=flattened_contour,
    sagitta_mm=FLATTEN_MM,
    colour=_colour_index,
)
DXF_R12 = LaserFormat(
    title="DXF of release 12, which has no unit",
    use="for old programs: set millimetres",
    suffix="_r12.dxf",
    write=lambda spec: dxf_text(spec.job, spec.colours, r12=True),
    read=read_dxf,
    tolerance_mm=_TOLERANCE_MM,
    colour=_colour_index,
    on_request=True,
)
