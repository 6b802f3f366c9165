"""Write the drawings that the page of maps imports anew: a survey, a plan, a robot's map, a scan.

Run it as ``python docs/draw_imports.py`` in a checkout. All show one cave, 600 by 400 mm: two
halls, two passages between them, and the rock that these enclose. It is invented.
"""

import warnings
from pathlib import Path

import ezdxf
import numpy as np
import shapely
from PIL import Image, ImageDraw
from pyogrio import raw

PLACE = Path(__file__).resolve().parent.parent / "examples" / "imports"

AREAS = (
    shapely.Polygon([(20, 60), (90, 20), (190, 40), (220, 150), (180, 330), (70, 380), (20, 250)]),
    shapely.Polygon([(400, 50), (520, 30), (580, 140), (560, 340), (450, 370), (390, 250)]),
    shapely.Polygon([(170, 60), (420, 70), (420, 130), (180, 120)]),
    shapely.Polygon([(150, 270), (420, 240), (420, 300), (150, 340)]),
)
"""Halls and passages in mm; they overlap, as those of a survey do."""

CELL_MM = 5.0
CELLS = (120, 80)

SCAN_DPI = 150
SCAN_PIXELS = (1754, 1240)
SCAN_SCALE = 0.4
"""Of millimetres on paper to those of the cave."""


def free_area() -> shapely.Geometry:
    """Return the whole of halls and passages, in mm."""
    return shapely.union_all(AREAS)


def write_dxf(path: Path) -> None:
    """Write the areas filled, in mm, on a layer of their own."""
    drawing = ezdxf.new("R2010", units=ezdxf.units.MM)
    for area in AREAS:
        hatch = drawing.modelspace().add_hatch(dxfattribs={"layer": "PASSAGES"})
        hatch.paths.add_polyline_path(area.exterior.coords[:-1], is_closed=True)
    drawing.saveas(path)


ROOM = (
    ((0, 0), (800, 0)), ((800, 0), (800, 600)), ((800, 600), (650, 600)),
    ((550, 600), (0, 600)), ((0, 600), (0, 0)), ((400, 0), (400, 220)), ((400, 340), (400, 600)),
)  # fmt: skip
TABLES = ((120, 120, 90, 60), (560, 380, 120, 80))
"""A room of two halves with a door each, in mm: lines, as they are drawn by hand; and boxes."""


def write_room(path: Path) -> None:
    """Write the lines of a room with door gaps, and tables as closed outlines."""
    drawing = ezdxf.new("R2010", units=ezdxf.units.MM)
    for begin, end in ROOM:
        drawing.modelspace().add_line(begin, end, dxfattribs={"layer": "WALLS"})
    for x, y, width, depth in TABLES:
        corners = [(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)]
        drawing.modelspace().add_lwpolyline(corners, close=True, dxfattribs={"layer": "TABLES"})
    drawing.saveas(path)


def write_survey(path: Path) -> None:
    """Write the areas a hundred times as large, in metres of a reference system."""
    path.unlink(missing_ok=True)
    metres = [shapely.transform(area, lambda xy: xy / 10.0 + [500e3, 5250e3]) for area in AREAS]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        raw.write(
            str(path),
            shapely.to_wkb(np.array(metres)),
            [],
            [],
            geometry_type="Polygon",
            crs="EPSG:32632",
            layer="passages",
        )


def pictured(
    size: tuple[int, int], pixels_per_mm: float, shift: tuple[float, float]
) -> Image.Image:
    """Return a white picture of the free area in black rock."""
    picture = Image.new("L", size, 0)
    for area in AREAS:
        pixels = (np.array(area.exterior.coords) + shift) * pixels_per_mm
        ImageDraw.Draw(picture).polygon([(x, size[1] - y) for x, y in pixels], fill=255)
    return picture


def write_robot_map(path: Path) -> None:
    """Write an occupancy grid of 6 by 4 m, as a robot's mapping does."""
    pictured(CELLS, 1.0 / CELL_MM, (0.0, 0.0)).save(path.with_suffix(".png"))
    path.write_text(
        "image: world.png\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n",
        encoding="utf-8",
    )


def write_scan(path: Path) -> None:
    """Write a sheet of A4 with the cave at SCAN_SCALE of its size."""
    per_mm = SCAN_DPI / 25.4
    plan = pictured(SCAN_PIXELS, per_mm * SCAN_SCALE, (60.0, 100.0))
    plan.convert("1").save(path, dpi=(SCAN_DPI, SCAN_DPI), optimize=True)


if __name__ == "__main__":
    PLACE.mkdir(exist_ok=True)
    write_dxf(PLACE / "cave.dxf")
    write_room(PLACE / "room.dxf")
    write_survey(PLACE / "survey.gpkg")
    write_robot_map(PLACE / "world.yaml")
    write_scan(PLACE / "scan.png")
