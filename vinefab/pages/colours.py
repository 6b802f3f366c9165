"""The colours of all pictures; loads no plotting."""

INK = "#1d2a30"
SOFT = "#5c6b73"
ROCK = "#d3dade"
ROCK_EDGE = "#8b989f"
ALERT = "#c2185b"
START = "#2e7d4f"
START_SHADE = "#c4dacd"

LEVEL_COLOURS = ("#12355b", "#b8430a", "#1c9a9a", "#eab000", "#6d2a82", "#7cc0f0", "#5f6b12")
"""Colour of each level, trunk first; they repeat after the last.

Levels that meet differ in lightness as well as in hue: they stay apart in a grey print and for
colour-blind readers (tests/pages/test_drawing.py measures both).
"""

HEAT_COLOURS = ("#fdf1dc", "#f6b65c", "#d9622b", "#8c2155", "#14213d")
"""From seldom to always: from light to dark, so that a grey print shows the same order."""


def level_colour(level: int) -> str:
    """Return the colour of a level, counted from 1."""
    return LEVEL_COLOURS[(level - 1) % len(LEVEL_COLOURS)]
