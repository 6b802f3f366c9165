"""What each design rule measures, drawn into a sketch from the subject that it looks at."""

import math

import numpy as np
import shapely
from numpy.typing import ArrayLike
from rule_sketch import Sketch, short_number
from rule_subjects import CROSSING, block, open_block, pieced, profile
from shapely.affinity import scale as scaled_shape

from vinefab.fabrication.calibration.coupons import coupon_pieces
from vinefab.fabrication.job.passes import STRAIGHT_BEFORE_MM, sleeve_size
from vinefab.fabrication.rules.catalog import RULES
from vinefab.fabrication.rules.clearance_rules import level_joints
from vinefab.fabrication.rules.pressure_rules import (
    deployed_capsules,
    pressure_gauge,
    safe_pressure_kpa,
    widest,
)
from vinefab.fabrication.rules.rule import Subject
from vinefab.fabrication.rules.tree_rules import lap_occupancies, occupancies
from vinefab.inflation.pattern import Pattern, pattern_of
from vinefab.model.job import Operation
from vinefab.model.laser import RecipeStatus
from vinefab.model.outline import Part
from vinefab.outline.body_outline import FlatLayout, flat_layout
from vinefab.physics.tube import (
    hoop_strain,
    inflated_diameter_mm,
    lap_load_n_mm,
    line_load_n_mm,
    seam_load_n_mm,
)
from vinefab.rig.part import Mesh

# --- What several rules show --------------------------------------------------------------------


def rows(subject: Subject, *names: str) -> list[int]:
    return [subject.names.index(name) for name in names]


def along(subject: Subject, row: int, share: float) -> np.ndarray:
    """Return the place at a share of a branch's length."""
    layout = subject.layout
    return layout.start_mm[row] + share * (layout.end_mm[row] - layout.start_mm[row])


def across(subject: Subject, row: int, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Return both edges of the lumen at a share of a branch's length."""
    heading = float(subject.layout.heading_rad[row])
    left = np.array([-math.sin(heading), math.cos(heading)])
    half = float(subject.layout.width_mm[row]) / 2.0
    middle = along(subject, row, share)
    return middle - half * left, middle + half * left


def stroke(subject: Subject, row: int) -> shapely.Polygon:
    """Return a branch with its round tip."""
    ends = [subject.layout.start_mm[row], subject.layout.end_mm[row]]
    return shapely.LineString(ends).buffer(float(subject.layout.width_mm[row]) / 2.0, quad_segs=24)


def outlined(subject: Subject, sketch: Sketch, box_mm: tuple[float, ...] | None = None) -> None:
    """Draw the outline, and show all of it or a box."""
    sketch.body(subject.outline.contour)
    if box_mm is not None:
        sketch.box_mm = box_mm


def around(*points: np.ndarray, pad_mm: float) -> tuple[float, ...]:
    places = np.array(points)
    return (*(places.min(axis=0) - pad_mm).tolist(), *(places.max(axis=0) + pad_mm).tolist())


def bars(sketch: Sketch, shown: list[tuple[str, float]], unit: str, most: float) -> None:
    """Draw numbers as bars from a common zero: the last is the limit of those before it."""
    limit = 150.0 * shown[-1][1] / most
    for number, (words, value) in enumerate(shown):
        is_limit, top = number == len(shown) - 1, -34.0 * number
        box = shapely.box(0.0, top - 9.0, 150.0 * value / most, top)
        sketch.draw(box, "film" if is_limit else "zone")
        sketch.draw(box, "soft" if is_limit else "m")
        label = f"{words} {short_number(value)} {unit}".rstrip()
        sketch.write(label, (0.0, top), (0.0, -5.0), "start")
        if not is_limit:
            sketch.line([(limit, top + 3.0), (limit, top - 15.0)], "dash")
    sketch.box_mm = (0.0, -34.0 * len(shown) + 22.0, 172.0, 18.0)


def lumen(sketch: Sketch, share: float, inside: str) -> None:
    """Draw the cross-section of a lumen and, to scale in area, the film that rides in it."""
    sketch.disc((0.0, 0.0), 1.0, "film")
    sketch.disc((0.0, 0.0), math.sqrt(share), "zone")
    sketch.disc((0.0, 0.0), 1.0, "rim")
    sketch.write(f"film {100.0 * share:.0f} %", (0.0, 0.0), (0.0, 4.0))
    sketch.says = inside


# --- Tree, widths -------------------------------------------------------------------------------


def draw_tree(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (280.0, -55.0, 370.0, 55.0))
    for row in rows(subject, "0.0", "0.1"):
        sketch.line([along(subject, row, 0.0), along(subject, row, 1.0)], "m")
    sketch.disc(subject.layout.end_mm[0], 2.0, "m")
    (row,) = rows(subject, "0.0")
    sketch.says = f"branches {subject.layout.tree.length_mm[row]:.3g} mm long"


def draw_crossing(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (470.0, -65.0, 565.0, 65.0))
    edge = subject.outline.contour.flattened_mm(0.05)
    noded = shapely.node(shapely.LineString(edge))
    ends = shapely.get_coordinates([shapely.get_point(p, i) for p in noded.geoms for i in (0, -1)])
    places = [one for one in ends if shapely.distance(*shapely.points([one, edge[0]])) > 1.0]
    places = [one for one in places if shapely.distance(*shapely.points([one, edge[-1]])) > 1.0]
    if places:
        sketch.draw(shapely.multipoints(places).buffer(4.0, quad_segs=16), "m")
    sketch.says = "no line crosses" if subject.body.is_valid else "the outline crosses itself"


def film_left(subject: Subject, sketch: Sketch, ends_mm: ArrayLike) -> None:
    """Draw the way from lumen to lumen, with the film that the beams leave on it."""
    start, end = np.asarray(ends_mm)[[0, -1]]
    left_mm = np.hypot(*(end - start)) - 2.0 * subject.taken_mm
    sketch.dimension(start, end, f"{left_mm:.3g} mm left")


def draw_pair(subject: Subject, sketch: Sketch) -> None:
    """Draw two grandchildren that come near each other, with their gap or their overlap."""
    outlined(subject, sketch, (470.0, -65.0, 565.0, 65.0))
    one, two = (stroke(subject, row) for row in rows(subject, "0.0.1", "0.1.0"))
    both = shapely.intersection(one, two)
    if not both.is_empty:
        sketch.draw(both, "zone")
        sketch.draw(both, "m")
        sketch.says = "two branches at one place"
        return
    ends = shapely.get_coordinates(shapely.shortest_line(one, two))
    film_left(subject, sketch, ends)
    sketch.says = "film left as made"


def draw_mouth(subject: Subject, sketch: Sketch) -> None:
    points = subject.outline.contour.points_mm
    sketch.body(subject.outline.contour)
    x = float(points[0][0])
    sketch.box_mm = (x - 11.0, -8.0, x + 15.0, 8.0)
    sketch.dimension(points[0], points[-1], aside_px=16.0)
    sketch.says = "width of the mouth"


def draw_leaf_width(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (285.0, -40.0, 375.0, 40.0))
    (row,) = rows(subject, "0.0")
    sketch.dimension(*across(subject, row, 0.72))
    sketch.says = "lay-flat width of the leaf"


def draw_ratio(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (220.0, -75.0, 385.0, 75.0))
    sketch.dimension(*across(subject, 0, 0.83))
    sketch.dimension(*across(subject, rows(subject, "0.0")[0], 0.48))
    wide, narrow = subject.design.build.widths_mm[:2]
    sketch.says = f"{wide:g} / {narrow:g} = {wide / narrow:.3g}"


def film_mm(subject: Subject) -> float:
    return subject.profile.material.film_mm


def draw_packing(subject: Subject, sketch: Sketch) -> None:
    count = subject.design.levels[0].branches
    lumen(
        sketch, occupancies(subject.design, film_mm(subject))[0], f"{count} branches in the trunk"
    )


def draw_built_width(subject: Subject, sketch: Sketch) -> None:
    """Draw a stretch of the tube: lumen as designed, beam, and lumen as it comes out."""
    settings = profile().settings(Operation.WELDCUT)
    offset = settings.seam_width_mm.value + settings.kerf_mm.value / 2.0
    box = subject.job.along(Operation.WELDCUT)[0].contour.box_mm
    beam = min(box[3] - box[1], box[2] - box[0]) / 2.0
    half = float(subject.layout.width_mm[0]) / 2.0
    for side in (-1.0, 1.0):
        sketch.line([(0.0, side * beam), (14.0, side * beam)], "beam")
        sketch.line([(0.0, side * half), (14.0, side * half)], "dash")
    sketch.draw(shapely.box(0.0, -beam + offset, 14.0, beam - offset), "film")
    sketch.dimension((3.5, -half), (3.5, half))
    sketch.dimension((10.0, -beam + offset), (10.0, beam - offset))
    sketch.write("design", (3.5, -half), (0.0, 24.0))
    sketch.write("built", (10.0, -half), (0.0, 24.0))
    sketch.box_mm = (0.0, -8.0, 14.0, 6.2)
    sketch.says = "blue: where the beam runs"


# --- Clearance and joints -----------------------------------------------------------------------


def draw_angle(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (270.0, -65.0, 570.0, 65.0))
    first, last = (float(subject.layout.heading_rad[row]) for row in rows(subject, "0.0", "0.1"))
    sketch.angle(subject.layout.end_mm[0], sorted((first, last)), 170.0)
    sketch.says = "angle between neighbours"


def draw_crotch(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (280.0, -45.0, 400.0, 45.0))
    joint = subject.layout.end_mm[0]
    reach = max(gap.reach_mm for gap in level_joints(subject.design)[0].gaps[1:-1])
    (row,) = rows(subject, "0.1")
    sketch.dimension(joint, joint + np.array([reach, 0.0]), aside_px=-34.0)
    sketch.line([joint, along(subject, row, 1.0)], "soft")
    sketch.disc(along(subject, row, 0.5), 1.6, "m")
    sketch.write("half", along(subject, row, 0.5), (-6.0, -6.0), "end")
    half = float(subject.layout.tree.length_mm[row]) / 2.0
    sketch.says = f"half of the branch: {half:.3g} mm"


def draw_fillet(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (315.0, -22.0, 360.0, 22.0))
    arcs = [one for one in subject.outline.contour.segments if one.part is Part.FILLET]
    arc = min(arcs, key=lambda one: abs(one.start_mm[1] + one.end_mm[1]))
    sketch.disc(arc.center_mm, arc.radius_mm, "m")
    x, y = arc.center_mm
    sketch.write(f"radius {arc.radius_mm:.2g} mm", (x, y), (14.0, -24.0), "middle")
    sketch.says = "fillet in the crotch"


def draw_foreign_fillet(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (285.0, -85.0, 400.0, 85.0))
    arcs = [one for one in subject.outline.contour.segments if one.part is Part.FILLET]
    arc = max(arcs, key=lambda one: one.radius_mm * (abs(one.start_mm[1] + one.end_mm[1]) < 1.0))
    sketch.line(arc.flattened_mm(0.05), "m")
    near = stroke(subject, rows(subject, "0.1.0")[0])
    ends = shapely.get_coordinates(
        shapely.shortest_line(shapely.LineString(arc.flattened_mm(0.05)), near)
    )
    film_left(subject, sketch, ends)
    sketch.says = f"fillet of {arc.radius_mm:.3g} mm"


def draw_turn(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (180.0, -190.0, 400.0, 190.0))
    heading = float(subject.layout.heading_rad[rows(subject, "0.1")[0]])
    sketch.angle(subject.layout.end_mm[0], (0.0, heading), 60.0)
    sketch.says = "turn at the joint"


def draw_pouch(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (425.0, -90.0, 560.0, 90.0))
    one, two = (
        shapely.Point(along(subject, row, 1.0)).buffer(
            subject.design.build.pouch.radius_mm, quad_segs=64
        )
        for row in rows(subject, "0.0", "0.1")
    )
    ends = shapely.get_coordinates(shapely.shortest_line(one, two))
    film_left(subject, sketch, ends)
    sketch.says = "film between pouches"


# --- Pressure and seams -------------------------------------------------------------------------


def default_limits(rule: str) -> object:
    return RULES[rule].limits_with({})


def draw_burst(subject: Subject, sketch: Sketch) -> None:
    width, _ = widest(subject)
    safe = safe_pressure_kpa(width, subject.profile.material, default_limits("VF-P01"))
    shown = [("works at", subject.design.build.pressure_kpa), ("seam stands", safe)]
    bars(sketch, shown, "kPa", 50.0)
    sketch.says = f"widest tube {width:g} mm"


def draw_rating(subject: Subject, sketch: Sketch) -> None:
    tested = subject.profile.material.seam.pressure_kpa.value
    bars(
        sketch,
        [("works at", subject.design.build.pressure_kpa), ("seam was tested at", tested)],
        "kPa",
        100.0,
    )
    sketch.says = f"tube of {subject.design.build.widths_mm[0]:g} mm"


def draw_window(subject: Subject, sketch: Sketch) -> None:
    gauge = pressure_gauge(subject, subject.profile, default_limits("VF-P03"))
    shown = [
        ("loose film takes", gauge.loose.pressure_kpa),
        ("tight film takes", gauge.tight.pressure_kpa),
        ("growth may take", gauge.growth_limit_kpa),
    ]
    bars(sketch, shown, "kPa", 45.0)
    wide, narrow = (f"{width:g}" for width in subject.design.build.widths_mm)
    sketch.says = f"trunk {wide}, leaf {narrow} mm"


def draw_strain(subject: Subject, sketch: Sketch) -> None:
    build, film = subject.design.build, subject.profile.material
    strain = 100.0 * hoop_strain(
        build.pressure_kpa, build.widths_mm[0], film.ply_mm.value, film.modulus_mpa.value
    )
    bars(sketch, [("film stretches", strain), ("limit", 50.0)], "%", 90.0)
    sketch.says = f"{build.widths_mm[0]:g} mm at {build.pressure_kpa:g} kPa"


def draw_seam(subject: Subject, sketch: Sketch) -> None:
    """Draw a stretch of one rim: lumen, seam between it and the kerf, beam."""
    settings = profile().settings(Operation.WELDCUT)
    kerf = settings.kerf_mm.value
    box = subject.job.along(Operation.WELDCUT)[0].contour.box_mm
    beam = min(box[3] - box[1], box[2] - box[0]) / 2.0 - float(subject.layout.width_mm[0]) / 2.0
    seam = beam - kerf / 2.0
    sketch.draw(shapely.box(0.0, -0.5, 1.8, 0.0), "film")
    sketch.draw(shapely.box(0.0, 0.0, 1.8, seam), "seam")
    sketch.line([(0.0, 0.0), (1.8, 0.0)], "rim")
    sketch.line([(0.0, beam), (1.8, beam)], "beam")
    sketch.dimension((0.35, 0.0), (0.35, seam), " ")
    sketch.write(f"seam {seam:.2g} mm", (0.95, seam / 2.0), (0.0, 4.0))
    sketch.write("lumen", (0.9, -0.25), (0.0, 4.0))
    sketch.write("beam", (1.5, beam), (0.0, -5.0))
    sketch.box_mm = (0.0, -0.5, 1.8, 0.85)
    sketch.says = f"recipe: seam {settings.seam_width_mm.value:g} mm"


# --- Shape under pressure -----------------------------------------------------------------------


def deployed(subject: Subject) -> tuple[Pattern, FlatLayout, list[shapely.Polygon]]:
    """Return a robot as deployed: its pattern, layout, and every inflated branch in plan."""
    pattern = subject.pattern or pattern_of(subject.design, subject.profile)
    capsules = deployed_capsules(pattern)
    ends = np.stack([capsules.start_mm, capsules.end_mm], axis=1)
    bodies = [
        shapely.LineString(line).buffer(float(half), quad_segs=24)
        for line, half in zip(ends, capsules.half_mm, strict=True)
    ]
    return pattern, flat_layout(pattern.deployed), bodies


def draw_deployed(subject: Subject, sketch: Sketch) -> None:
    """Draw a joint under pressure over its flat outline; dashed: where children are designed."""
    pattern, layout, bodies = deployed(subject)
    sketch.body(subject.outline.contour, "other")
    sketch.draw(shapely.union_all(bodies), "zone")
    joint = layout.end_mm[0]
    for heading in layout.heading_rad[1:].tolist():
        away = np.array([math.cos(heading), math.sin(heading)])
        sketch.line([joint, joint + 150.0 * away], "m")
    designed = flat_layout(pattern.design)
    for heading in designed.heading_rad[1:].tolist():
        away = np.array([math.cos(heading), math.sin(heading)])
        sketch.line([joint, joint + 150.0 * away], "dash")
    sketch.box_mm = (joint[0] - 60.0, -95.0, joint[0] + 165.0, 95.0)
    (first, last) = np.degrees(layout.heading_rad[1:]).tolist()
    (low, high) = np.degrees(designed.heading_rad[1:]).tolist()
    sketch.write(f"deploys {last - first:.1f} deg apart", joint, (20.0, 96.0))
    sketch.says = f"designed {high - low:.3g} deg apart"


def draw_sensitivity(subject: Subject, sketch: Sketch) -> None:
    joint = subject.layout.end_mm[0]
    outlined(subject, sketch, (joint[0] - 40.0, -110.0, joint[0] + 190.0, 110.0))
    first, last = (float(subject.layout.heading_rad[row]) for row in (1, 2))
    sketch.angle(joint, (first, last), 105.0)
    found = subject.pattern.joints[0].found
    sketch.says = f"1 deg cut, {found.sensitivity:.2f} deployed"


def draw_crotch_load(subject: Subject, sketch: Sketch) -> None:
    (joint,), build = subject.pattern.joints, subject.design.build
    load = joint.found.crotch_load * line_load_n_mm(build.pressure_kpa, joint.width_mm)
    stands = seam_load_n_mm(subject.profile.material.seam)
    stands /= RULES["VF-I03"].limits["safety_factor"]
    bars(sketch, [("crotch pulls with", load), ("seam stands", stands)], "N/mm", 0.9)
    sketch.says = f"fillet {build.fillet_mm[0]:g} mm, {build.pressure_kpa:g} kPa"


def draw_bodies(subject: Subject, sketch: Sketch) -> None:
    """Draw the inflated branches in plan, and where they lie on each other."""
    _, layout, bodies = deployed(subject)
    for body in bodies:
        sketch.draw(body, "film")
        sketch.draw(body, "rim")
    one, two = (bodies[row] for row in rows(subject, "0.0.1", "0.1.0"))
    both = shapely.intersection(one, two)
    x, y = layout.end_mm[0].tolist()
    sketch.box_mm = (x + 20.0, y - 75.0, x + 190.0, y + 75.0)
    if both.is_empty:
        ends = shapely.get_coordinates(shapely.shortest_line(one, two))
        sketch.dimension(ends[0], ends[1])
        sketch.says = "inflated, side by side"
        return
    sketch.draw(both, "zone")
    sketch.draw(both, "m")
    sketch.says = "inflated, on each other"


# --- Base and reach -----------------------------------------------------------------------------


def draw_tail(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (-240.0, -32.0, 110.0, 34.0))
    tail = subject.layout.tail_mm
    sketch.dimension((-tail, 0.0), (0.0, 0.0))
    sketch.disc((0.0, 0.0), 3.0, "m")
    sketch.says = "tail: from the mouth to the base"


def draw_clamp(subject: Subject, sketch: Sketch) -> None:
    points = subject.outline.contour.points_mm
    x = float(points[0][0])
    outlined(subject, sketch, (x - 55.0, -62.0, x + 120.0, 62.0))
    sketch.dimension(points[0], points[-1], aside_px=14.0)
    collar = subject.design.build.collar
    sketch.says = f"collar for a {collar.clamp_diameter_mm:g} mm tube" if collar else "no collar"


def draw_reach(subject: Subject, sketch: Sketch) -> None:
    outlined(subject, sketch, (-210.0, -60.0, 450.0, 60.0))
    tip = subject.layout.end_mm[0]
    sketch.dimension((0.0, 0.0), tip)
    sketch.says = "longest path, base to tip"


# --- Pieces -------------------------------------------------------------------------------------


def draw_sleeve_room(subject: Subject, sketch: Sketch) -> None:
    """Draw the straight stretch that a sleeve takes on a branch that parts the overlap."""
    sketch.body(subject.outline.contour)
    sketch.box_mm = (380.0, -120.0, 520.0, 120.0)
    (row,) = rows(subject, "0.1.0")
    size = sleeve_size(subject.design.build, profile())
    start, heading = subject.layout.start_mm[row], float(subject.layout.heading_rad[row])
    step = np.array([math.cos(heading), math.sin(heading)])
    unparted = subject.partition.unparted
    if unparted:
        room = unparted[0].room_mm
        first = subject.layout.end_mm[row] - room * step
        needed = size.room_mm
        sketch.says = f"straight {room:.0f}, needed {needed:.0f} mm"
    else:
        sleeve = subject.partition.sleeve(subject.partition.sleeves[0].branch)
        begin = min(sleeve.outer_from_mm, sleeve.blend_end_mm) - STRAIGHT_BEFORE_MM
        first, needed = start + begin * step, size.room_mm
        sketch.says = f"a sleeve takes {needed:.0f} mm"
    sketch.dimension(first, first + needed * step, f"{needed:.0f} mm", aside_px=14.0)


_PIECE_FILLS = ("film", "other", "seam", "zone")


def draw_pieces(subject: Subject, sketch: Sketch) -> None:
    for number, piece in enumerate(subject.pieces or (subject,)):
        sketch.body(piece.outline.contour, _PIECE_FILLS[number % len(_PIECE_FILLS)])
    for number, piece in enumerate(subject.partition.pieces):
        sketch.write("ABCDEF"[number], along(subject, piece.root, 0.75), (0.0, 4.0))
    sketch.box_mm = (240.0, -130.0, 520.0, 130.0)
    count, most = len(subject.partition.pieces), subject.design.build.pieces.most
    sketch.says = f"pieces: {count}, allowed: {most}"


def draw_lap(subject: Subject, sketch: Sketch) -> None:
    (sleeve, *_), bond = subject.partition.sleeves, subject.profile.recipe.lap
    load = lap_load_n_mm(subject.design.build.pressure_kpa, sleeve.width_mm)
    bears = bond.load_n_per_mm.value / RULES["VF-J03"].limits["safety_factor"]
    bars(sketch, [("pulled with", load), ("lap bears", bears)], "N/mm", 0.5)
    sketch.says = f"{sleeve.width_mm:.3g} mm at {subject.design.build.pressure_kpa:g} kPa"


def draw_ease(subject: Subject, sketch: Sketch) -> None:
    pieces, bond = subject.design.build.pieces, subject.profile.recipe.lap
    most = pieces.lap_mm - bond.band_mm.value
    bars(sketch, [("ease", pieces.ease_mm), ("lap less band", most)], "mm", 20.0)
    sketch.says = f"at least {film_mm(subject):g} mm, the film"


def draw_lap_packing(subject: Subject, sketch: Sketch) -> None:
    shares = lap_occupancies(subject.design, subject.partition.sleeves, film_mm(subject))
    count = len(subject.partition.sleeves)
    lumen(sketch, shares[0], f"film with {count} lap{'s' * (count != 1)} in the trunk")


def draw_labels(subject: Subject, sketch: Sketch) -> None:
    """Draw the paths around a socket, with the label next to it or where it should be."""
    whole = pieced(*CROSSING)().job
    marks = [one for one in whole.along(Operation.MARK) if "socket B" in one.label]
    place = shapely.union_all([shapely.LineString(one.contour.flattened_mm()) for one in marks])
    x, y = place.centroid.coords[0]
    sketch.box_mm = (x - 62.0, y - 34.0, x + 50.0, y + 42.0)
    shown, is_there = shapely.box(*sketch.box_mm), False
    for one in subject.job.paths:
        line = shapely.LineString(one.contour.flattened_mm(0.05)) & shown
        if not line.is_empty:
            sketch.draw(line, "m" if one.operation is Operation.MARK else "rim")
            is_there |= "socket B" in one.label
    if not is_there:
        sketch.draw(place.envelope.buffer(3.0), "m")
    sketch.says = "label of the socket" if is_there else "socket without its label"


# --- Sheet --------------------------------------------------------------------------------------


def draw_bed(subject: Subject, sketch: Sketch) -> None:
    machine = subject.profile.machine
    wide, high = machine.bed_width_mm.value, machine.bed_height_mm.value
    for number, sheet in enumerate(subject.job.runs):
        low = -number * (high + 100.0)
        sketch.draw(shapely.box(0.0, low, wide, low + high), "other")
        for one in sheet.paths:
            if one.operation is not Operation.MARK:
                sketch.draw(one.contour.moved(0.0, 0.0, low), "rim")
        sketch.draw(shapely.box(0.0, low, wide, low + high), "m")
    sketch.write(f"bed {wide:g} x {high:g} mm", (wide / 2.0, low), (0.0, 18.0))
    x0, y0, x1, y1 = sketch.seen_mm()
    sketch.box_mm = (x0, y0 - 150.0, x1, y1)
    tiles = len(subject.job.tiles)
    sketch.says = f"in {tiles} tiles" if tiles else "whole and in tiles too large"


def draw_roll(subject: Subject, sketch: Sketch) -> None:
    roll = subject.profile.material.roll_width_mm.value
    shape = shapely.Polygon(subject.outline.contour.flattened_mm(0.1))
    x, y = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shape))[:3].T
    sides = np.hypot(np.diff(x), np.diff(y))
    long = int(sides.argmax())
    turn = math.atan2(y[long + 1] - y[long], x[long + 1] - x[long])
    moved = subject.outline.contour.moved(-turn, 0.0, 0.0)
    box = moved.box_mm
    middle = (box[1] + box[3]) / 2.0
    low, high = middle - roll / 2.0, middle + roll / 2.0
    sketch.draw(shapely.box(box[0] - 60.0, low, box[2] + 60.0, high), "other")
    sketch.body(moved)
    left = box[0] - 60.0
    sketch.dimension((left, low), (left, high), f"roll {roll:g} mm", aside_px=-16.0)
    sketch.says = f"robot {box[3] - box[1]:.0f} mm wide"


# --- Laser --------------------------------------------------------------------------------------


def draw_mark(subject: Subject, sketch: Sketch) -> None:
    body = subject.job.along(Operation.WELDCUT)[0].contour
    mark = subject.job.paths[0].contour
    top = body.box_mm[3]
    sketch.draw(shapely.box(280.0, top - 6.0, 330.0, top), "film")
    sketch.line([(280.0, top), (330.0, top)], "rim")
    sketch.line(mark.points_mm, "beam")
    x, y = mark.points_mm[0].tolist()
    sketch.dimension((x + 1.5, top), (x + 1.5, y))
    sketch.write("body", (307.0, top - 3.0), (0.0, 4.0))
    sketch.write("mark", (311.0, y), (0.0, -5.0))
    sketch.box_mm = (295.0, top - 6.0, 319.0, top + 9.0)
    sketch.says = "mark above the rim"


def draw_twice(subject: Subject, sketch: Sketch) -> None:
    one, two = (path.contour.points_mm for path in subject.job.paths[-2:])
    sketch.line(one, "beam")
    sketch.line(two, "rim")
    for ends in (one, two):
        for end in ends:
            sketch.disc(end, 0.35, "rim")
    shared = shapely.intersection(shapely.LineString(one), shapely.LineString(two))
    if shared.length:
        ends = shapely.get_coordinates(shared)
        sketch.line(ends, "m")
        sketch.dimension(ends[0], ends[-1], aside_px=16.0)
    sketch.says = "cut twice" if shared.length else "each place cut once"
    sketch.box_mm = (498.0, 492.0, 532.0, 508.0)


def draw_order(subject: Subject, sketch: Sketch) -> None:
    cuts = [path.contour for path in subject.job.paths[-2:]]
    for contour in sorted(cuts, key=lambda one: -abs(one.signed_area_mm2)):
        sketch.draw(shapely.Polygon(contour.points_mm), "film")
        sketch.draw(contour, "m")
    for number, contour in enumerate(cuts, start=1):
        x0, _, x1, y1 = contour.box_mm
        sketch.write(f"{number}", ((x0 + x1) / 2.0, y1), (0.0, 15.0))
    inner_first = abs(cuts[0].signed_area_mm2) < abs(cuts[1].signed_area_mm2)
    sketch.says = "inner before outer" if inner_first else "the inner film has moved"
    sketch.box_mm = (395.0, 395.0, 505.0, 505.0)


def draw_ply(subject: Subject, sketch: Sketch) -> None:
    ply = subject.profile.material.ply_mm.value
    for number in range(2):
        box = shapely.box(0.0, number * ply, 0.2, (number + 1) * ply)
        sketch.draw(box, "film" if number else "other")
        sketch.draw(box, "rim")
    sketch.dimension((0.05, ply), (0.05, 2.0 * ply), f"{ply:g} mm")
    limit = RULES["VF-L04"].limits["error"]
    sketch.line([(0.0, ply + limit), (0.2, ply + limit)], "dash")
    sketch.box_mm = (0.0, -0.02, 0.2, 0.13)
    sketch.says = "two plies; dashed: limit"


def draw_machine(subject: Subject, sketch: Sketch) -> None:
    machine, settings = subject.profile.machine, subject.profile.settings(Operation.MARK)
    shown = [
        ("speed asked", settings.speed_mm_s.value),
        ("machine's most", machine.speed_max_mm_s.value),
    ]
    bars(sketch, shown, "mm/s", 650.0)
    sketch.says = "speed of marking"


def draw_status(subject: Subject, sketch: Sketch) -> None:
    """Draw a coupon: dashed until it was cut and measured."""
    coupon = next(one for one in coupon_pieces(profile()) if one.name == "CROTCH-R8")
    measured = subject.profile.recipe.status is not RecipeStatus.UNVERIFIED
    for one in coupon.paths:
        if measured or one.operation is not Operation.MARK:
            sketch.draw(one.contour, "m" if measured else "dash")
    sketch.says = "coupons cut, measured" if measured else "coupons not yet cut"


def draw_bend(subject: Subject, sketch: Sketch) -> None:
    """Draw the band that a tip seals along a bend, and the tip at its tightest place."""
    (seam,) = subject.job.paths
    width = subject.profile.settings(Operation.WELD).seam_width_mm.value
    line = shapely.LineString(seam.contour.flattened_mm(0.01))
    sketch.draw(line.buffer(width / 2.0, cap_style="flat"), "film")
    sketch.line(shapely.get_coordinates(line), "beam")
    x, y = shapely.get_coordinates(line.interpolate(0.5, normalized=True))[0].tolist()
    sketch.disc((x, y), width / 2.0, "m")
    sketch.box_mm = (93.0, 97.0, 106.0, 108.0)
    radius = min(segment.radius_mm for segment in seam.contour.segments)
    sketch.says = f"tip of {width:g} mm, bend of {radius:g} mm"


def draw_open_mouth(subject: Subject, sketch: Sketch) -> None:
    seams = subject.job.along(Operation.WELDCUT)
    for seam in seams:
        sketch.line(seam.contour.flattened_mm(0.1), "rim")
    if len(seams) > 1:
        sketch.line(seams[0].contour.points_mm, "m")
    x, y = seams[-1].contour.points_mm[[0, -1]].mean(axis=0).tolist()
    sketch.box_mm = (x - 60.0, y - 50.0, x + 60.0, y + 50.0)
    sketch.says = "sealed across the mouth" if len(seams) > 1 else "open at the mouth"


# --- Files and rig ------------------------------------------------------------------------------


def draw_readback(subject: Subject, sketch: Sketch) -> None:
    """Draw the model, and over it what a file holds."""
    body = shapely.Polygon(subject.outline.contour.flattened_mm(0.1))
    problems = [one for found in subject.readback.values() for one in found]
    sketch.body(subject.outline.contour)
    read = scaled_shape(body, 1.0, 0.9, origin=(0.0, 0.0)) if problems else body
    sketch.draw(shapely.LineString(read.exterior.coords[:-1]), "m")
    sketch.box_mm = (200.0, -130.0, 460.0, 130.0)
    sketch.says = problems[0] if problems else "outline.dxf is the model"


def draw_solid(subject: Subject, sketch: Sketch) -> None:
    corners, faces = block()
    mesh = open_block() if subject.rig.parts[0].problems else Mesh(vertices_mm=corners, faces=faces)
    turn = np.array([[0.82, 0.57, 0.0], [-0.3, 0.43, 0.85], [0.49, -0.7, 0.53]])
    seen = mesh.vertices_mm[mesh.faces] @ turn.T
    normal = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
    facing = normal[:, 2] > 0.0
    height = mesh.vertices_mm[mesh.faces][:, :, 2].max(axis=1)
    for row in np.lexsort((height, facing)):  # what faces away lies behind all that does not
        face = shapely.Polygon(seen[row][:, :2])
        if facing[row] or (subject.rig.parts[0].problems and height[row] > 29.0):
            sketch.draw(face, "film" if facing[row] else "zone")
            sketch.draw(face, "soft" if facing[row] else "m")
    problems = subject.rig.parts[0].problems
    sketch.says = "its top is missing" if problems else "closed, faces outward"


def draw_fits(subject: Subject, sketch: Sketch) -> None:
    room, part = subject.rig.room_mm, subject.rig.parts[0].size_mm
    sketch.draw(shapely.box(0.0, 0.0, *room[:2]), "other")
    sketch.draw(shapely.box(0.0, 0.0, *room[:2]), "soft")
    low = [(one - two) / 2.0 for one, two in zip(room, part, strict=True)]
    box = shapely.box(low[0], low[1], low[0] + part[0], low[1] + part[1])
    sketch.draw(box, "film")
    sketch.draw(box, "rim")
    middle = low[1] + part[1] / 2.0
    sketch.dimension((low[0], middle), (low[0] + part[0], middle), f"{part[0]:g} mm")
    sketch.box_mm = (-30.0, -5.0, room[0] + 30.0, room[1] + 5.0)
    sketch.says = f"bed {room[0]:g} x {room[1]:g} mm"


def draw_corridor(subject: Subject, sketch: Sketch) -> None:
    width = subject.corridors[0].corridors[0].width_mm
    tube = inflated_diameter_mm(subject.design.build.widths_mm[0])
    body = shapely.LineString([(-20.0, 0.0), (22.0, 0.0)]).buffer(tube / 2.0, quad_segs=16)
    for side in (-1.0, 1.0):
        wall = shapely.box(12.0, side * width / 2.0, 60.0, side * (width / 2.0 + 16.0))
        sketch.draw(wall, "rock")
    sketch.draw(body, "film")
    walls = shapely.box(12.0, -60.0, 60.0, 60.0) - shapely.box(12.0, -width / 2, 60.0, width / 2)
    pressed = body & walls
    if not pressed.is_empty:
        sketch.draw(pressed, "zone")
    sketch.draw(body, "rim")
    sketch.dimension((42.0, -width / 2.0), (42.0, width / 2.0))
    sketch.dimension((0.0, -tube / 2.0), (0.0, tube / 2.0))
    sketch.box_mm = (-16.0, -34.0, 64.0, 34.0)
    sketch.says = "inflated body, corridor"


def draw_height(subject: Subject, sketch: Sketch) -> None:
    height = subject.rig.height_mm
    tube = inflated_diameter_mm(subject.design.build.widths_mm[0])
    sketch.draw(shapely.box(-5.0, -3.0, 75.0, 0.0), "rock")
    sketch.draw(shapely.box(44.0, 0.0, 60.0, height), "rock")
    sketch.disc((18.0, tube / 2.0), tube / 2.0, "film")
    sketch.disc((18.0, tube / 2.0), tube / 2.0, "rim")
    sketch.dimension((18.0 - tube / 2.0, 0.0), (18.0 - tube / 2.0, tube), aside_px=10.0)
    sketch.dimension((60.0, 0.0), (60.0, height), aside_px=-12.0)
    sketch.box_mm = (-34.0, -3.0, 98.0, 44.0)
    sketch.says = f"height / diameter = {height / tube:.2g}"
