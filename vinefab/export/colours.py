"""Which layer and colour each operation gets in laser files.

A preset changes nothing else: the geometry of a path is the same in every one. A preset may leave
an operation out, where the programs that it is made for would cut whatever they meet.

The default colours are the only ones that are exact in DXF's primaries, in the six colours of
Epilog's driver and in LightBurn's palette at once; ``reg`` and ``doc`` have the colours of
LightBurn's two tool layers, which it never cuts.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from vinefab.core.errors import BadInputError
from vinefab.core.registry import Registry
from vinefab.model.job import Operation


@dataclass(frozen=True, slots=True, kw_only=True)
class Style:
    """How one operation is drawn.

    Parameters
    ----------
    layer
        Name of its layer.
    rgb
        Colour in SVG, ``#RRGGBB``.
    aci
        Colour in DXF: AutoCAD colour index, 1 to 255.
    """

    layer: str
    rgb: str
    aci: int

    def __post_init__(self) -> None:
        if not 1 <= self.aci <= 255:
            raise BadInputError("aci", self.aci, "1 to 255")
        if len(self.rgb) != 7 or not self.rgb.startswith("#"):
            raise BadInputError("rgb", self.rgb, "#RRGGBB")


@dataclass(frozen=True, slots=True, kw_only=True)
class Colours:
    """A preset: one style per operation.

    Parameters
    ----------
    name
        What machines and users call it.
    title
        Whom it is for, in words.
    styles
        Style by operation; an operation that is missing is not written.
    """

    name: str
    title: str
    styles: Mapping[Operation, Style]

    def __post_init__(self) -> None:
        object.__setattr__(self, "styles", MappingProxyType(dict(self.styles)))


BLACK, BLUE, MAGENTA, RED = ("#000000", 7), ("#0000FF", 5), ("#FF00FF", 6), ("#FF0000", 1)
ORANGE, SKY = ("#F36926", 30), ("#0C96D9", 140)

VARIANT_COLOURS = (
    *(("#00E000", 3), ("#FF8000", 30), ("#00E0E0", 4), ("#A00000", 12)),
    *(("#0000A0", 172), ("#D0D000", 2), ("#A000A0", 212), ("#00A000", 92)),
    *(("#00A0FF", 150), ("#C08000", 42), ("#A0A000", 52), ("#B4B4B4", 9)),
)
"""Colours of LightBurn's palette for settings that differ from the recipe's, with near indices."""


def _styles(colours: Mapping[Operation, tuple[str, int]]) -> dict[Operation, Style]:
    return {op: Style(layer=op.layer, rgb=rgb, aci=aci) for op, (rgb, aci) in colours.items()}


DEFAULT = Colours(
    name="default",
    title="one layer and one colour per operation",
    styles=_styles(
        {
            Operation.MARK: BLACK,
            Operation.WELD: BLUE,
            Operation.WELDCUT: MAGENTA,
            Operation.CUT: RED,
            Operation.REG: ORANGE,
            Operation.DOC: SKY,
        }
    ),
)

# The one-pass outline gets the labs' second vector colour and not their red: a mouth that is cut
# with the outline's settings would be welded shut. Nothing that must not be cut is in the file,
# for a printer driver cuts every hairline whatever its colour.
RED_CUT = Colours(
    name="red_cut",
    title="labs that cut red, score blue and engrave black",
    styles=_styles(
        {
            Operation.MARK: BLACK,
            Operation.WELD: BLUE,
            Operation.WELDCUT: BLUE,
            Operation.CUT: RED,
        }
    ),
)

SHOP_SINGLE = Colours(
    name="shop_single",
    title="shops that want one layer and one colour, and cut all of it",
    styles={
        operation: Style(layer="0", rgb="#000000", aci=7)
        for operation in (Operation.WELDCUT, Operation.CUT)
    },
)

PRESETS: Registry[Colours] = Registry(
    "colour preset", {preset.name: preset for preset in (DEFAULT, RED_CUT, SHOP_SINGLE)}
)
"""All presets by name."""
