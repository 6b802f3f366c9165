"""Draw the words of the glossary at what they name: an outline, and a deployment.

`docs/draw_pictures.py` writes the files.
"""

import math

import numpy as np
import shapely
from rule_sketch import Sketch, single

from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Collar, Design, Level, Pouch
from vinefab.model.map import Map
from vinefab.model.outline import Part
from vinefab.outline.body_outline import body_outline, flat_layout

SEAM_MM = 3.0
"""Of the picture; a real one is a few tenths of a millimetre."""


def word_pictures() -> dict[str, str]:
    """Return the pictures of the glossary by their names."""
    return {
        "anatomy.svg": single("The outline of a design with the names of its parts", anatomy()),
        "growth.svg": single("One deployment with the names of its events", growth()),
    }


# --- Outline ------------------------------------------------------------------------------------


def labelled_design() -> Design:
    return Design(
        name="words",
        trunk_length_mm=120.0,
        levels=(Level.of(branches=3, length_mm=105.0, angle_deg=110.0),),
        build=Build(
            widths_mm=(40.0, 24.0),
            fillet_mm=(9.0,),
            taper=(1.0, 0.7),
            tail_mm=90.0,
            pouch=Pouch(shape="rectangle", length_mm=30.0, width_mm=34.0),
            collar=Collar(clamp_diameter_mm=40.0, length_mm=25.0, flare_mm=30.0),
        ),
    )


def anatomy() -> Sketch:
    """Return the outline, growing upward, with the names of its parts."""
    design, sketch = labelled_design(), Sketch()
    layout, contour = flat_layout(design), body_outline(design).contour.moved(math.pi / 2, 0.0, 0.0)
    body = shapely.Polygon(contour.flattened_mm(0.05))
    mouth = shapely.box(-60.0, -120.0, 60.0, -design.build.tail_mm)
    sketch.draw(body.buffer(SEAM_MM) - mouth, "seam")
    sketch.body(contour, "other")
    for arc in contour.segments:
        if arc.part is Part.FILLET:
            sketch.line(arc.flattened_mm(0.05), "fillet")
    ends = [turned(layout.end_mm[row]) for row in range(len(layout.tree))]
    joint = ends[0]
    for end in ends[1:]:
        sketch.line([joint, end], "dash")
    sketch.line([(0.0, -design.build.tail_mm), joint], "dash")
    _name_trunk(sketch, design, joint)
    _name_fan(sketch, joint, ends[1:])
    sketch.box_mm = (-165.0, -118.0, 165.0, 262.0)
    return sketch


def turned(point_mm: np.ndarray) -> np.ndarray:
    """Return a place of the flat layout, the trunk pointing up."""
    return np.array([-point_mm[1], point_mm[0]])


def _name_trunk(sketch: Sketch, design: Design, joint: np.ndarray) -> None:
    tail = design.build.tail_mm
    sketch.dimension((-36.0, -tail), (-36.0, 0.0), "tail", aside_px=16.0)
    sketch.dimension((-36.0, 0.0), (-36.0, joint[1]), "trunk (level 1)", aside_px=16.0)
    sketch.dimension((36.0, -tail), (36.0, -tail + 55.0), "collar", aside_px=-16.0)
    sketch.dimension((-20.0, 62.0), (20.0, 62.0), " ")
    sketch.point_out("lay-flat width", (12.0, 62.0), (40.0, 30.0), "start")
    sketch.point_out("seam", (20.0 + SEAM_MM / 2.0, 20.0), (32.0, 14.0), "start")
    sketch.write("lumen", (0.0, 12.0), (0.0, 4.0))
    sketch.point_out("mouth", (12.0, -tail), (30.0, 26.0), "start")
    sketch.disc((0.0, 0.0), 2.0, "rim")
    sketch.point_out("base", (0.0, 0.0), (46.0, 18.0), "start")
    sketch.disc(joint, 2.0, "rim")
    sketch.point_out("joint", joint, (-76.0, 14.0), "end")


def _name_fan(sketch: Sketch, joint: np.ndarray, ends: list[np.ndarray]) -> None:
    headings = [math.atan2(*(end - joint)[::-1]) for end in ends]
    first, middle, last = sorted(headings)
    around = np.linspace(first, last, 60)
    fan = joint + 74.0 * np.column_stack([np.cos(around), np.sin(around)])
    sketch.line(fan, "soft")
    sketch.point_out("fan (theta)", fan[44], (-18.0, -66.0), "end")
    turn = np.linspace(first, middle, 30)
    crotch = joint + 52.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    sketch.line(crotch, "soft")
    sketch.point_out("crotch: the angle|between neighbours|at a joint", crotch[12], (86.0, -98.0))
    place = joint + 33.5 * np.array([math.cos((middle + last) / 2), math.sin((middle + last) / 2)])
    sketch.point_out("fillet", place, (-58.0, -90.0), "end")
    right, left = ends[headings.index(first)], ends[headings.index(last)]
    sketch.point_out("leaf (tapered)", joint + 0.5 * (right - joint) + (4.0, -8.0), (30.0, 50.0))
    sketch.point_out("pouch", left, (-24.0, 58.0))
    step = (right - joint) / float(np.hypot(*(right - joint)))
    side = np.array([step[1], -step[0]])
    sketch.point_out("neck", right - 16.0 * step + 10.0 * side, (24.0, 40.0), "start")


# --- Deployment ---------------------------------------------------------------------------------


def small_map() -> Map:
    corners = (
        [(60, 120), (150, 150), (170, 200), (80, 190)],
        [(230, 60), (340, 80), (330, 115), (240, 110)],
        [(250, 190), (360, 175), (360, 215), (260, 225)],
    )
    obstacles = tuple(shapely.Polygon(ring) for ring in corners)
    return Map(name="words", bounds=shapely.box(0.0, 0.0, 400.0, 260.0), obstacles=obstacles)


def growth() -> Sketch:
    """Return a trunk with two children, grown on a small map."""
    world, sketch = small_map(), Sketch()
    design = Design(
        name="words",
        trunk_length_mm=308.0,
        levels=(Level.of(branches=2, length_mm=150.0, angle_deg=80.0),),
        build=Build.standard(2),
    )
    grown = design.grow(world, (122.0, 15.0, 30.0), body="centerline")
    for rock in world.obstacles:
        sketch.draw(rock, "rock")
    sketch.draw(world.bounds, "rim")
    for row in range(3):
        sketch.line(grown.chain_mm(row), ("trunk", "child", "child")[row])
        sketch.disc(grown.chain_mm(row)[-1], 4.0, "rim")
    _name_growth(sketch, grown)
    sketch.box_mm = (-4.0, -4.0, 536.0, 268.0)
    return sketch


def _name_growth(sketch: Sketch, grown: Deployment) -> None:
    base, contact, tip = grown.chain_mm(0)
    launched = base + 76.0 * np.array([math.cos(math.radians(30.0)), math.sin(math.radians(30.0))])
    sketch.line([base, launched], "dash")
    sketch.write("launch heading", launched, (6.0, 12.0), "start")
    sketch.point_out("pose: base|and heading", base, (-44.0, -18.0))
    sketch.point_out("contact: the body|is wrapped round|this corner", contact, (-110.0, -2.0))
    sketch.point_out("trunk's|tip: joint of|its children", tip, (24.0, 4.0), "start")
    sketch.point_out(
        "slides|along a wall|to full|length", grown.chain_mm(1)[-1], (16.0, -20.0), "start"
    )
    sketch.point_out("wedge:|stops as|corner", grown.chain_mm(2)[-1], (16.0, 8.0), "start")
    sketch.write("free space", (60.0, 235.0))
    sketch.write("obstacle", (115.0, 165.0), (0.0, 4.0))
