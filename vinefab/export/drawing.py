"""What a laser file says once it is read again, whatever its format."""

from dataclasses import dataclass
from enum import StrEnum

from vinefab.model.outline import Contour


class Format(StrEnum):
    """The formats that are read back."""

    DXF = "dxf"
    SVG = "svg"
    LIGHTBURN = "lightburn"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DrawnPath:
    """One path of a file.

    Parameters
    ----------
    layer
        The layer it is on.
    colour
        ``#RRGGBB`` from an SVG or a LightBurn project, a colour index in digits from a DXF.
    contour
        Its lines and arcs, y up, in the file's unit.
    """

    layer: str
    colour: str
    contour: Contour


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drawing:
    """A file as read.

    Parameters
    ----------
    format
        Which kind of file it was.
    unit
        ``mm``, or in words what the file says instead.
    sheet
        Width and height in the file's unit; None where the format has no sheet.
    paths
        In the order of the file.
    layer_colours
        Colour of each layer that has one of its own (DXF), in the form of `DrawnPath.colour`.
    oddities
        Whatever was found that vinefab never writes, in words.
    """

    format: Format
    unit: str
    sheet: tuple[float, float] | None
    paths: tuple[DrawnPath, ...]
    layer_colours: dict[str, str]
    oddities: tuple[str, ...] = ()
