"""Marks on the film around the pieces of a robot: labels of pieces and joints, depths of plugs.

All of them lie beside the pieces, on film that is cut away: whoever lifts a piece out of the sheet
writes its letters on it first.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import counted
from vinefab.fabrication.job.marks import (
    CLEAR_MM,
    TICK_MM,
    Box,
    FreeRoom,
    LabelTarget,
    Marking,
    body_area,
    fold_marking,
    label_marking,
    label_paths,
    mark,
    short_name,
)
from vinefab.fabrication.job.placement import SheetRobot
from vinefab.fabrication.outline.layout import FlatLayout, flat_layout
from vinefab.fabrication.outline.stroke import LocalFrame, Point, placed
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour
from vinefab.model.pieces import Partition, Sleeve, piece_label

PLUG, SOCKET = "plug", "socket"


def joint_mark(end: str, sleeve: str, title: str) -> str:
    """Return what the marks beside a plug or socket are called."""
    return f"{end} {sleeve} of {title}"


def piece_mark(title: str) -> str:
    """Return what the label of a piece is called."""
    return f"label of {title}"


def marks_of_pieces(
    robots: Sequence[SheetRobot],
    bodies: Sequence[LaserPath],
    profile: LaserProfile,
    within: Box,
    partition: Partition,
) -> Marking:
    """Return the marks of the pieces on one sheet, as far as there is room."""
    if Operation.MARK not in profile.recipe.by_operation:
        return Marking()
    # What seals a piece with stubs is several open paths: its outline encloses it.
    taken = [path for path in bodies if path.operation is Operation.CUT or not path.of]
    taken += [replace(robot.paths[0], contour=robot.outline) for robot in robots]
    free = FreeRoom(taken, within, [body_area(robot) for robot in robots])
    layout = flat_layout(robots[0].design)
    made = [fold_marking(robot, free) for robot in robots if robot.piece == piece_label(0)]
    for path in (path for one in made for path in one.paths):
        free.take_path(path)
    for own, robot in enumerate(robots):
        for sleeve in partition.sleeves:
            for end, on in ((SOCKET, sleeve.socket_on), (PLUG, sleeve.plug_on)):
                if on == robot.piece:
                    made.append(_joint(robot, free, layout, (own, end, sleeve)))
    made += [
        _piece(robot, free, layout, profile, (own, partition)) for own, robot in enumerate(robots)
    ]
    return Marking(
        paths=tuple(path for one in made for path in one.paths),
        left_out=tuple(message for one in made for message in one.left_out),
    )


def _frame(layout: FlatLayout, branch: int) -> LocalFrame:
    x, y = layout.start_mm[branch].tolist()
    return LocalFrame((x, y), float(layout.heading_rad[branch]))


def _joint(
    robot: SheetRobot, free: FreeRoom, layout: FlatLayout, joint: tuple[int, str, Sleeve]
) -> Marking:
    """Return the label beside a plug or socket and, beside a plug, how deep it goes.

    Where no tick has room beside the plug, the label says the depth.
    """
    own, end, sleeve = joint
    name, frame = joint_mark(end, sleeve.label, robot.title), _frame(layout, sleeve.branch)
    beyond = sleeve.plug_mm if end == PLUG else sleeve.socket_mm
    paths: list[LaserPath] = []
    words, left_out = f"{sleeve.label} up", []
    if end == PLUG:
        paths = [mark(tick, name, robot.of) for tick in _depth(robot, sleeve, frame, free)]
        for path in paths:
            free.take_path(path)
        if not paths:
            words += f" {sleeve.lap_mm:g} mm"
    near = _on_sheet(robot, placed((beyond, 0.0), frame))
    target = LabelTarget(near_mm=near, label=name, name=robot.of, own=own)
    label = label_paths([words], free, target)
    if not label:
        left_out.append(f"no room for the label of {name}")
    return Marking(paths=(*paths, *label), left_out=tuple(left_out))


def _depth(
    robot: SheetRobot, sleeve: Sleeve, frame: LocalFrame, free: FreeRoom
) -> Iterator[Contour]:
    """Yield the ticks on both sides of a plug, as deep as it goes into the socket, if free."""
    first = sleeve.width_mm / 2.0 + robot.body.reach_mm + CLEAR_MM
    for side in (-1.0, 1.0):
        ends = [placed((sleeve.socket_mm, side * (first + more)), frame) for more in (0.0, TICK_MM)]
        tick = robot.on_sheet(Contour.polyline(np.array(ends), closed=False))
        if free.has(tick):
            yield tick


def _on_sheet(robot: SheetRobot, point: Point) -> Point:
    """Return where a point of the flat layout lies on the sheet."""
    two = np.array([point, (point[0] + 1.0, point[1])])
    x, y = robot.on_sheet(Contour.polyline(two, closed=False)).points_mm[0].tolist()
    return x, y


def _piece(
    robot: SheetRobot,
    free: FreeRoom,
    layout: FlatLayout,
    profile: LaserProfile,
    place: tuple[int, Partition],
) -> Marking:
    """Return the label of a piece; where all of it has no room, its letter alone."""
    own, partition = place
    root = next(piece.root for piece in partition.pieces if piece.label == robot.piece)
    middle = float(layout.tree.length_mm[root]) / 2.0 if root else 0.0
    near = _on_sheet(robot, placed((middle, 0.0), _frame(layout, root)))
    target = LabelTarget(near_mm=near, label=piece_mark(robot.title), name=robot.of, own=own)
    copy = f" copy {robot.number} of {robot.count}" if robot.count > 1 else ""
    full = [
        f"{robot.piece} of {counted(len(partition.pieces), 'piece')}{copy}",
        short_name(robot.design.name),
        short_name(profile.recipe.name),
        GENERATOR.removeprefix("written by "),
    ]
    return label_marking(full, {"letter": robot.piece}, free, target)
