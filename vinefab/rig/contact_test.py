"""The contact coupon: a board whose walls are met at 5, 10 ... 40 degrees from head-on.

Every lane begins with an opening, and ends at a wall that is turned by its angle out of the
heading's way. A straight tube that is grown into the lane meets the middle of the wall, and either
stops there or slides off it. The lanes stand in two rows that grow towards each other. The board is
a map like any other, so that a rig is made of it, and growth can be simulated on it.
"""

import csv
import io
import math
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Polygon, box
from shapely.affinity import rotate

from vinefab.core.errors import UnfitInputError
from vinefab.core.limits import rad
from vinefab.model.design import Build, Design, design_text
from vinefab.model.map import Map, Pose, Start
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    INK,
    ROCK,
    ROCK_EDGE,
    SOFT,
    Ink,
    Page,
    level_colour,
    page_of,
    plan_panel,
)
from vinefab.rig.part import Printer, RigOptions
from vinefab.rig.rig_plan import usable_mm

ANGLES_DEG = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0)
"""From head-on, of the walls: the first four in the lower row, from the left, then the upper ones
from the right, each as its tube sees it."""

TRIALS = 5
"""Rows of the table for each wall."""

CONTACTS_NAME, STRIP_NAME, MAP_NAME = "contacts.csv", "strip.toml", "contact_test.geojson"
PICTURE_NAME, README_NAME = "contact_test.svg", "README.txt"

STRIP_WIDTH_MM = 16.0
"""Lay-flat width of the tube that is grown: 10 mm inflated."""

ENTRY_MM = 22.0
"""Openings let the flat tube in."""

_LANE_MM, _WALL_MM, _THICK_MM = 42.0, 26.0, 8.0
_START_MM = 10.0
_AHEAD_MM, _BEYOND_MM = 45.0, 50.0  # from the bounds to the middle of a wall, and from there on


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactLane:
    """A lane of the board: where its tube starts, and the wall that it meets."""

    angle_deg: float  # from head-on
    start: Pose
    wall: Polygon
    met_mm: tuple[float, float]  # where the middle of the tube would meet it
    end_mm: tuple[float, float]  # the end of the wall that a sliding tip passes

    def turned(self, middle_mm: tuple[float, float]) -> "ContactLane":
        """Return the lane turned by half a turn about a point."""
        x, y = (2.0 * middle for middle in middle_mm)
        start = Pose(
            x_mm=x - self.start.x_mm,
            y_mm=y - self.start.y_mm,
            heading_rad=self.start.heading_rad - math.pi,
        )
        return ContactLane(
            angle_deg=self.angle_deg,
            start=start,
            wall=rotate(self.wall, 180.0, origin=middle_mm),
            met_mm=(x - self.met_mm[0], y - self.met_mm[1]),
            end_mm=(x - self.end_mm[0], y - self.end_mm[1]),
        )


def contact_lanes() -> tuple[ContactLane, ...]:
    """Return the lanes of the board, by their angles."""
    half = len(ANGLES_DEG) // 2
    middle_mm = (0.5 * half * _LANE_MM, _AHEAD_MM + _BEYOND_MM)
    lower = [_lane(place, angle) for place, angle in enumerate(ANGLES_DEG[:half])]
    upper = [_lane(place, angle).turned(middle_mm) for place, angle in enumerate(ANGLES_DEG[half:])]
    return *lower, *upper


def _lane(place: int, angle_deg: float) -> ContactLane:
    """Return a lane of the lower row; its tip slides to the right.

    The wall's front passes through the point that the tube is aimed at, so that its angle alone
    tells the lanes apart. Behind it the wall is closed to a block.
    """
    x_mm = place * _LANE_MM + 0.5 * _WALL_MM
    slope, reach = math.tan(rad(angle_deg)), 0.5 * _WALL_MM
    left, right = -slope * reach, slope * reach
    back = right + _THICK_MM
    outline = [(-reach, left), (reach, right), (reach, back), (-reach, back)]
    wall = Polygon([(x_mm + x, _AHEAD_MM + y) for x, y in outline])
    return ContactLane(
        angle_deg=angle_deg,
        start=Pose(x_mm=x_mm, y_mm=_START_MM, heading_rad=0.5 * math.pi),
        wall=wall,
        met_mm=(x_mm, _AHEAD_MM),
        end_mm=(x_mm + reach, _AHEAD_MM + right),
    )


def contact_map() -> Map:
    """Return the board as a map; its starts are the lanes'."""
    lanes = contact_lanes()
    wide_mm = len(ANGLES_DEG) // 2 * _LANE_MM
    return Map(
        name="contact_test",
        bounds=box(0.0, 0.0, wide_mm, 2.0 * (_AHEAD_MM + _BEYOND_MM)),
        obstacles=tuple(lane.wall for lane in lanes),
        starts=tuple(Start(pose=lane.start) for lane in lanes),
        environment="contact_test",
    )


def strip_design() -> Design:
    """Return the straight tube that is grown in the lanes."""
    length_mm = 1.6 * _AHEAD_MM
    build = Build.standard(1, trunk_width_mm=STRIP_WIDTH_MM)
    return Design(name="contact_strip", trunk_length_mm=length_mm, build=build)


def contact_options(printer: Printer, options: RigOptions) -> RigOptions:
    """Return the options of a rig for the board: one plate without markers, openings for strips.

    Raises
    ------
    UnfitInputError
        If it is not one part on the printer's bed, or a choice of style or scale was made.
    """
    for name in ("style", "scale"):
        if name in options.model_fields_set:
            problem = "is given for the contact test, which is one plate at its own size"
            raise UnfitInputError(name, problem, "leave it out")
    usual = {
        "markers": "none",
        "entry_width_mm": ENTRY_MM,
        "base_start": 0,
        "height_mm": 20.0,
        "plate_mm": 1.6,
    }
    chosen = {name: value for name, value in usual.items() if name not in options.model_fields_set}
    options = options.changed(style="plate", **chosen)
    room_mm, rim_mm = usable_mm(printer, options), 2.0 * options.border_mm
    needs_mm = [side + rim_mm for side in contact_map().size_mm]
    if any(need > room for need, room in zip(sorted(needs_mm), sorted(room_mm), strict=True)):
        problem = (
            f"has {room_mm[0]:g} x {room_mm[1]:g} mm, and the contact test takes "
            f"{needs_mm[0]:g} x {needs_mm[1]:g} mm on one bed"
        )
        raise UnfitInputError(f"the bed of {printer.name}", problem, "take a larger printer")
    return options


def contact_files(surface: str, world: Map) -> dict[str, bytes]:
    """Return what belongs to the printed board: table, instructions, picture, tube and map."""
    return {
        CONTACTS_NAME: contact_table(surface).encode(),
        README_NAME: contact_readme(surface).encode(),
        PICTURE_NAME: page_svg(contact_plan()),
        STRIP_NAME: design_text(strip_design()).encode(),
        MAP_NAME: world.json_text().encode(),
    }


def contact_table(surface: str) -> str:
    """Return the table to fill in: yes or no for each trial."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["angle_from_head_on_deg", "grew_on", "surface"])
    rows.writerows([f"{angle:g}", "", surface] for angle in ANGLES_DEG for _ in range(TRIALS))
    return text.getvalue()


def contact_readme(surface: str) -> str:
    """Return the steps of the test."""
    return f"""Contact coupon: at which angle does a tip slide along this wall?

1. Print the board as your obstacles are printed: same printer, filament and settings. Its walls are
   the surface {surface!r}. Write the angles on it as {PICTURE_NAME} shows them.
2. Make straight tubes of your film, {STRIP_WIDTH_MM:g} mm wide lay-flat:
   vinefab fabricate {STRIP_NAME} --out strips --recipe NAME
   Another width is another test: note its diameter.
3. Hold a tube in an opening, straight, and grow it at your working pressure until its tip meets the
   wall. Keep the pressure for some seconds.
4. Did the tip slide along the wall and past its end? Write yes as grew_on, else no. A tube that
   missed the wall, kinked or leaked does not count: leave the cell empty and grow it again.
5. {TRIALS} trials at each angle, each with the tube drawn back and turned anew: {CONTACTS_NAME}.
6. vinefab fit-observations {CONTACTS_NAME} --out contacts.toml
   adds the half-angle of this surface, with its 95 % interval, to contacts.toml. Give that file to
   report and compare (--contacts contacts.toml), and name the surface in your maps:
   "vinefab": {{"surface": "{surface}"}} in the map file.

{MAP_NAME} is the board as a map, with a start in each lane; with --pose X,Y,DEG
vinefab grow {STRIP_NAME} --map {MAP_NAME} simulates a trial.
"""


def contact_plan() -> Page:
    """Return the plan of the board with its angles and the ways of tips that slide."""
    world, lanes = contact_map(), contact_lanes()
    x_min, y_min, x_max, y_max = world.bounds.bounds
    panel = plan_panel((x_min - 6.0, y_min - 12.0, x_max + 6.0, y_max + 12.0), 504.0)
    panel.polygons([world.bounds], Ink(line=INK))
    panel.polygons([lane.wall for lane in lanes], Ink(fill=ROCK, line=ROCK_EDGE))
    radius_mm = STRIP_WIDTH_MM / math.pi
    for lane in lanes:
        ahead = np.array([math.cos(lane.start.heading_rad), math.sin(lane.start.heading_rad)])
        base = np.array([lane.start.x_mm, lane.start.y_mm]) - _START_MM * ahead
        tip = np.array(lane.met_mm) - radius_mm / math.cos(rad(lane.angle_deg)) * ahead
        tube = shapely.LineString([base, tip]).buffer(radius_mm)
        panel.polygons([tube], Ink(fill=level_colour(1), line=level_colour(1), fill_alpha=0.25))
        # The way of a tip that slides: along the wall, then past its end.
        aside, film = np.array([ahead[1], -ahead[0]]), Ink(line=level_colour(2), width_pt=1.2)
        along = np.array(lane.end_mm) - lane.met_mm
        slid = tip + along + 2.0 * radius_mm * aside
        panel.line([tip, tip + along, slid], replace(film, dash_pt=(3.0, 2.0)))
        panel.arrow(slid, slid + 12.0 * ahead, film, 6.0, 5)
        middle = lane.wall.centroid
        panel.words((middle.x, middle.y - 1.5), f"{lane.angle_deg:g}", 11.0, bold=True,
                    anchor="middle", halo=True)  # fmt: skip
        row = -9.0 if ahead[1] > 0.0 else 7.5
        panel.words((base[0], base[1] + row), "grow", 8.0, anchor="middle")
    panel.x_name = panel.y_name = "mm of the rig"
    panel.title = (
        "contact test: numbers are degrees from head-on; grew on: the tip passes the wall's end"
    )
    panel.line([(x_min, 0.5 * (y_min + y_max)), (x_max, 0.5 * (y_min + y_max))],
               Ink(line=SOFT, width_pt=0.5, dash_pt=(2.0, 3.0)))  # fmt: skip
    return page_of(panel)
