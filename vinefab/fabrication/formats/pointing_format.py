"""G-code that shows where crosses are: for film in tiles on machines that have no pointer.

The tip, cold, or the blade runs over both lines of a cross without touching the film, and waits
over its middle (M0) until someone presses a button. The crosses to align by come first, and a
second time, for pushing the film to one moves it at the others; then those to draw.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from vinefab.core.errors import UnfitInputError, UnreadableFileError
from vinefab.core.plain_text import GENERATOR, counted
from vinefab.fabrication.formats.gcode_format import (
    GCODE_MARK,
    GCODE_TOOLS,
    driven_paths,
    gcode_comment,
    gcode_number,
    gcode_xy,
)
from vinefab.fabrication.formats.laser_drawing import (
    DrawnPath,
    LaserFileSpec,
    LaserFormat,
    ReadDrawing,
    StyledPath,
)
from vinefab.model.job import Operation
from vinefab.model.machine import LiftingMachine
from vinefab.model.outline import Contour
from vinefab.outline.joint import Point

POINT_MM = 1.0
"""Height over the film at which a tool shows a cross (assumed: free of wrinkles, easy to sight)."""

_TOLERANCE_MM = 1e-3
_SHOW_MM_MIN = 600.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cross:
    """A cross on the film."""

    lines: tuple[StyledPath, ...]
    to_draw: bool  # by hand, for later tiles; else it is there, to align by

    @property
    def middle_mm(self) -> Point:
        """The place where its lines meet."""
        x, y = np.mean([line.path.contour.points_mm for line in self.lines], axis=(0, 1)).tolist()
        return x, y


def crosses_of(spec: LaserFileSpec) -> list[Cross]:
    """Return a tile's crosses: those to align by, then those to draw."""
    keys = "targets_found_mm", "robot_targets_found_mm"
    there = [point for key in keys for point in _points(spec.job.facts.get(key))]
    lines = [styled for styled in spec.paths if styled.path.operation is Operation.REG]
    crosses = []
    for pair in zip(lines[::2], lines[1::2], strict=True):
        one = Cross(lines=pair, to_draw=True)
        known = any(math.dist(one.middle_mm, point) < _TOLERANCE_MM for point in there)
        crosses.append(Cross(lines=pair, to_draw=not known))
    return sorted(crosses, key=lambda cross: cross.to_draw)


def _points(value: object) -> list[list[float]]:
    return value if isinstance(value, list) else []


def pointing_paths(spec: LaserFileSpec) -> tuple[StyledPath, ...]:
    """Return the lines of a tile's crosses that its machine runs over, in order.

    None where no machine with a lowered tool makes the tile.
    """
    if _machine(spec) is None:
        return ()
    return tuple(line for cross in crosses_of(spec) for line in cross.lines)


def _machine(spec: LaserFileSpec) -> LiftingMachine | None:
    driven = driven_paths(spec)
    if not driven:
        return None
    profile = spec.recipe_profile
    machine = profile.machine_of(driven[0].path.settings_in(profile).tool)
    return machine if isinstance(machine, LiftingMachine) else None


def pointing_text(spec: LaserFileSpec) -> str:
    """Return G-code that shows a tile's crosses one after the other.

    Raises
    ------
    UnfitInputError
        If the job has no cross, or no machine with a lowered tool.
    """
    machine, crosses = _machine(spec), crosses_of(spec)
    if machine is None or not crosses:
        problem = "it has no cross for a machine with a lowered tool"
        raise UnfitInputError(f"job {spec.job.name}", problem, "write it for tiles alone")
    aligning = [cross for cross in crosses if not cross.to_draw]
    drawing = [cross for cross in crosses if cross.to_draw]
    height, plunge = machine.travel_z_mm.value, 60.0 * machine.plunge_mm_s.value
    lift = f"G0 Z{gcode_number(height)} F{gcode_number(plunge)}"
    bed = f"{gcode_number(machine.bed_width_mm.value)} {gcode_number(machine.bed_height_mm.value)}"
    lines = [
        f"; {GENERATOR}",
        f"; {gcode_comment(spec.job.name)}: {counted(len(aligning), 'cross')} to align by, "
        f"{counted(len(drawing), 'cross')} to draw",
        f"; machine {machine.name}: {gcode_comment(machine.title)}",
        "; nothing is heated or sealed: the tool stays over the film and waits at every cross (M0)",
        f";BED {bed}",
        "G21 ; millimetres",
        "G90 ; absolute",
        ";START",
        *(machine.start_gcode.splitlines() or ["G28 ; home"]),
        ";START END",
        "M104 S0 ; cold",
        lift,
    ]
    number = 0
    for at, cross in enumerate(aligning, start=1):
        lines += _shown(machine, cross, number, f"align {at} of {len(aligning)}", lift)
        number += len(cross.lines)
    for at, cross in enumerate(aligning, start=1):
        lines += _waiting(machine, cross, f"check {at} of {len(aligning)}", lift)
    for at, cross in enumerate(drawing, start=1):
        lines += _shown(machine, cross, number, f"draw {at} of {len(drawing)}", lift)
        number += len(cross.lines)
    lines += [";END", *(machine.end_gcode.splitlines() or ["M84 ; release the motors"]), ";END END"]
    return "\n".join(lines) + "\n"


def _shown(
    machine: LiftingMachine, cross: Cross, before: int, words: str, lift: str
) -> Iterator[str]:
    """Yield the way along both lines of a cross, over the film, and the wait over its middle."""
    for number, line in enumerate(cross.lines, start=before + 1):
        start, end = line.path.contour.points_mm.tolist()
        label = gcode_comment(line.path.label)
        yield f";PATH {number} {line.style.layer} {line.style.rgb} {label}"
        yield _over(machine, start)
        yield _low(machine)
        yield f"G1 {gcode_xy(end)} F{gcode_number(_SHOW_MM_MIN)}"
        yield ";PATH END"
    yield from _waiting(machine, cross, words, lift)


def _waiting(machine: LiftingMachine, cross: Cross, words: str, lift: str) -> Iterator[str]:
    yield _over(machine, cross.middle_mm)
    yield _low(machine)
    yield f"M0 {words}"
    yield lift


def _over(machine: LiftingMachine, to_mm: Sequence[float]) -> str:
    x, y = to_mm
    return f"G0 {gcode_xy((x, y))} F{gcode_number(60.0 * machine.speed_max_mm_s.value)}"


def _low(machine: LiftingMachine) -> str:
    height = min(POINT_MM, machine.travel_z_mm.value)
    return f"G0 Z{gcode_number(height)} F{gcode_number(60.0 * machine.plunge_mm_s.value)}"


_WORDS = re.compile(r"([XYZ])(-?\d+(?:\.\d+)?)")
_KNOWN = ("G0", "G1", "G21", "G90", "M0", "M104")


def read_pointing(text: str) -> ReadDrawing:
    """Read G-code of ours that shows crosses: the lines that the tool runs over.

    Raises
    ------
    UnreadableFileError
        If it is not G-code of ours.
    """
    lines = text.splitlines()
    if not lines or not lines[0].startswith(GCODE_MARK):
        raise UnreadableFileError(
            "G-code text", "not G-code of ours: it does not begin with its mark"
        )
    reader = _Reader()
    for line in lines:
        if line.startswith(";"):
            reader.note(line[1:].split())
        elif reader.own:
            reader.obey(line.partition(";")[0])
    return ReadDrawing(paths=tuple(reader.paths), oddities=tuple(dict.fromkeys(reader.odd)))


@dataclass(slots=True)
class _Reader:
    """A machine that reads G-code: where it is, and the lines that it has shown."""

    own: bool = True  # whether lines are ours, not the start and end of the machine's file
    at: dict[str, float] = field(default_factory=lambda: dict.fromkeys("XYZ", math.nan))
    bed: Point = (math.inf, math.inf)
    title: tuple[str, str] = ("", "")  # layer and colour of the line that is shown
    paths: list[DrawnPath] = field(default_factory=list)
    odd: list[str] = field(default_factory=list)

    def note(self, words: Sequence[str]) -> None:
        """Take in a comment."""
        match words:
            case ["PATH", "END"]:
                self.title = "", ""
            case ["PATH", _, layer, colour, *_]:
                self.title = layer, colour
            case ["BED", width, height]:
                self.bed = float(width), float(height)
            case ["START" | "END"]:
                self.own = False
            case ["START" | "END", "END"]:
                self.own = True

    def obey(self, code: str) -> None:
        """Obey a command."""
        name = code.split(maxsplit=1)[0] if code.strip() else ""
        if name not in _KNOWN:
            self.odd.append(f"a command {name}")
        if name not in ("G0", "G1"):
            return
        before, self.at = self.at, {**self.at, **_numbers(code)}
        if self.at["Z"] <= 0.0:
            self.odd.append("a move in the film")
        x, y = self.at["X"], self.at["Y"]
        if min(x, y) < 0.0 or x > self.bed[0] or y > self.bed[1]:
            self.odd.append(f"a move off the bed, to {x:g}, {y:g}")
        if name == "G1" and self.title[0]:
            layer, colour = self.title
            ends = np.array([(before["X"], before["Y"]), (x, y)])
            contour = Contour.polyline(ends, closed=False)
            self.paths.append(DrawnPath(layer=layer, colour=colour, contour=contour))


def _numbers(code: str) -> dict[str, float]:
    return {letter: float(value) for letter, value in _WORDS.findall(code)}


POINTING = LaserFormat(
    title="G-code that shows the crosses of a tile and waits at each",
    use="to align film on a machine without a pointer; nothing is heated",
    suffix="_point.gcode",
    write=pointing_text,
    read=read_pointing,
    tolerance_mm=_TOLERANCE_MM,
    paths=pointing_paths,
    tools=GCODE_TOOLS,
    needs_profile=True,
    each_operation=False,
    where_needed=True,
)
