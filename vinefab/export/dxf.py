"""Laser jobs as DXF: R2010, millimetres, polylines with true arcs."""

import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from ezdxf import options  # type: ignore[attr-defined]
from ezdxf.document import Drawing
from ezdxf.filemanagement import new

from vinefab.core.jsontext import GENERATOR
from vinefab.export.colours import DEFAULT, Colours
from vinefab.export.drawn import StyledPath, metadata, styled_paths
from vinefab.model.job import Job
from vinefab.model.outline import FLATTEN_MM, Contour

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

    Parameters
    ----------
    job
        The paths, in millimetres from the sheet's lower left corner.
    colours
        Layers and colours.
    polyline
        Flatten arcs to chords at most 0.01 mm away, for programs that ignore bulges.
    r12
        Write release 12: POLYLINE instead of LWPOLYLINE, and no unit, for it knows none.

    Returns
    -------
    str
        The same bytes for the same job and the same ezdxf.
    """
    with _fixed_metadata():
        document = new(RELEASE_12) if r12 else new(VERSION, units=MILLIMETRES)
        _describe(document, job, colours)
        for styled in styled_paths(job, colours):
            _add(document, styled, polyline=polyline)
        _register_classes(document)
        stream = io.StringIO()
        document.write(stream)
    # Group 999 is a comment; at the top every reader skips it, and people see it first.
    return f"999\n{GENERATOR}\n{stream.getvalue()}"


def drawn_contour(contour: Contour, *, polyline: bool) -> Contour:
    """Return a contour as it is written: itself, or its chords."""
    if not polyline:
        return contour
    return Contour.polyline(contour.flattened_mm(FLATTEN_MM), closed=contour.closed)


def _describe(document: Drawing, job: Job, colours: Colours) -> None:
    document.header["$MEASUREMENT"] = METRIC
    for key, value in metadata(job, colours).items():
        document.header.custom_vars.append(key, value)
    space = document.modelspace()
    space.reset_limits((0.0, 0.0), (job.sheet_width_mm, job.sheet_height_mm))
    boxes = np.array([styled.path.contour.box_mm for styled in styled_paths(job, colours)])
    if len(boxes):
        low, high = boxes[:, :2].min(axis=0).tolist(), boxes[:, 2:].max(axis=0).tolist()
        space.reset_extents((*low, 0.0), (*high, 0.0))


def _add(document: Drawing, styled: StyledPath, *, polyline: bool) -> None:
    style = styled.style
    if style.layer not in document.layers:
        document.layers.add(style.layer, color=style.aci)
    contour = drawn_contour(styled.path.contour, polyline=polyline)
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


def _register_classes(document: Drawing) -> None:
    """List the classes of what the file holds by name; ezdxf would take them from a set."""
    if document.dxfversion != AC1009:
        for name in sorted(document.entitydb.dxf_types_in_use()):
            document.classes.add_class(name)


@contextmanager
def _fixed_metadata() -> Iterator[None]:
    """Keep the clock and random identifiers out of the file; ezdxf has only a global switch.

    It also warns of every file of release 12 that it has no unit, which nobody can change.
    """
    before, level = options.write_fixed_meta_data_for_testing, _EZDXF_LOG.level
    options.write_fixed_meta_data_for_testing = True
    _EZDXF_LOG.setLevel(logging.ERROR)
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before
        _EZDXF_LOG.setLevel(level)
