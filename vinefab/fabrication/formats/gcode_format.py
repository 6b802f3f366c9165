"""G-code for machines that press a tool on film: hot tips and trailing blades.

Coordinates are absolute millimetres from the bed's lower left corner; there is no E word, so
nothing is extruded. Z is 0 at the top of the film as it lies. Comments that begin with ``;PATH``
name the path that follows; machines skip them.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from vinefab.core.errors import BadInputError, UnfitInputError, UnreadableFileError
from vinefab.core.plain_text import GENERATOR, counted, one_line
from vinefab.fabrication.formats.laser_drawing import (
    DrawnPath,
    LaserFileSpec,
    LaserFormat,
    ReadDrawing,
    StyledPath,
)
from vinefab.fabrication.job.blade import AxisMove, Point, ahead_mm, axis_moves, point_after
from vinefab.fabrication.job.timing import schedule
from vinefab.model.laser import RecipeStatus
from vinefab.model.machine import (
    HotTip,
    Knife,
    KnifeMachine,
    LiftingMachine,
    Machine,
    OperationSettings,
    Tool,
)
from vinefab.model.outline import Contour, Segment

_DECIMALS = 5
_TOLERANCE_MM = 1e-3
GCODE_MARK = f"; {GENERATOR.partition(' ')[0]} "
CHORD_MM = 0.02
"""Largest distance of chords from arcs, for machines whose firmware has no arcs."""


# --- What a file holds ----------------------------------------------------------------------------


def driven_paths(spec: LaserFileSpec) -> tuple[StyledPath, ...]:
    """Return the paths of the first tool with G-code, as its machine runs them.

    Closed paths run past their start by the overcut. Arcs are chords where the firmware has none.
    """
    profile = spec.recipe_profile
    driven = [
        (styled, settings)
        for styled in spec.paths
        if styled.path.operation.is_machined
        for settings in [styled.path.settings_in(profile)]
        if settings.tool in GCODE_TOOLS
    ]
    found = []
    for styled, settings in driven:
        machine = profile.machine_of(settings.tool)
        if settings.tool is not driven[0][1].tool or not isinstance(machine, LiftingMachine):
            continue
        contour = run_past_start(styled.path.contour, settings.overcut_mm.value)
        if not machine.arcs:
            contour = Contour.polyline(contour.flattened_mm(CHORD_MM), closed=False)
        found.append(replace(styled, path=replace(styled.path, contour=contour)))
    return tuple(found)


def run_past_start(contour: Contour, by_mm: float) -> Contour:
    """Return a closed path as an open one that runs past its start; an open one as it is."""
    if not contour.closed:
        return contour
    segments = list(contour.segments)
    left, at = by_mm, 0
    ring = list(segments)
    while left > 0.0:
        first = segments[at % len(segments)]
        share = min(1.0, left / first.length_mm)
        turn = share * first.turn_rad
        middle = first.end_mm if share == 1.0 else _along(first, share)
        ring.append(replace(first, end_mm=middle, bulge=math.tan(turn / 4.0)))
        left, at = left - first.length_mm, at + 1
    return Contour.from_segments(ring, closed=False)


def _along(segment: Segment, share: float) -> Point:
    (x0, y0), (x1, y1) = segment.start_mm, segment.end_mm
    if not segment.bulge:
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0)
    x, y = segment.center_mm
    cos, sin = math.cos(share * segment.turn_rad), math.sin(share * segment.turn_rad)
    return x + cos * (x0 - x) - sin * (y0 - y), y + sin * (x0 - x) + cos * (y0 - y)


def path_settings(spec: LaserFileSpec) -> dict[str, dict[str, str]]:
    """Return what each path must run with, by its number: heights, speeds, temperatures."""
    profile = spec.recipe_profile
    return {
        f"path {number}": _drive_of(styled.path.settings_in(profile)).expected
        for number, styled in enumerate(driven_paths(spec), start=1)
    }


# --- Writing --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class _Drive:
    """How a tool runs along a path: what differs between processes."""

    feed_mm_min: float
    depths_mm: tuple[float, ...]  # height of each pass
    dwell_s: float = 0.0
    celsius: float | None = None  # of the tool; None: it is not heated

    @property
    def expected(self) -> dict[str, str]:
        """What a reader finds of it."""
        heat = {} if self.celsius is None else {"celsius": gcode_number(self.celsius)}
        return {
            "feed_mm_min": gcode_number(self.feed_mm_min),
            "depths_mm": ", ".join(map(gcode_number, self.depths_mm)),
            "dwell_s": gcode_number(self.dwell_s),
            **heat,
        }


def _drive_of(settings: OperationSettings) -> _Drive:
    if isinstance(settings, HotTip):
        return _Drive(
            feed_mm_min=60.0 * settings.seal_speed_mm_s.value,
            depths_mm=(settings.touch_z_mm.value,) * settings.passes,
            dwell_s=settings.dwell_s.value,
            celsius=settings.seal_temperature_c.value,
        )
    if isinstance(settings, Knife):
        count, depth = settings.passes, settings.depth_mm.value
        return _Drive(
            feed_mm_min=60.0 * settings.cut_speed_mm_s.value,
            depths_mm=tuple(-depth * k / count for k in range(1, count + 1)),
        )
    raise BadInputError("tool", settings.tool, f"one of {', '.join(GCODE_TOOLS)}")


def gcode_text(spec: LaserFileSpec) -> str:
    """Return the G-code of a job's paths that one machine with a lowered tool runs.

    Raises
    ------
    UnfitInputError
        If no such machine runs any, or a path leaves its bed.
    """
    profile, paths = spec.recipe_profile, driven_paths(spec)
    machine = None if not paths else profile.machine_of(paths[0].path.settings_in(profile).tool)
    if not isinstance(machine, LiftingMachine):
        problem = "no hot tip and no knife runs any of its paths"
        raise UnfitInputError(f"job {spec.job.name}", problem, "name a recipe that has one")
    lines = [
        *_head(spec, machine, paths),
        "G21 ; millimetres",
        "G90 ; absolute",
        ";START",
        *(machine.start_gcode.splitlines() or ["G28 ; home"]),
        ";START END",
        *_warm_up(spec, paths),
        _up(machine),
        *_PATHS[machine.tool](spec, machine, paths),
        *_cool_down(machine, paths[0].path.settings_in(profile)),
    ]
    return "\n".join(lines) + "\n"


def _head(
    spec: LaserFileSpec, machine: LiftingMachine, paths: Sequence[StyledPath]
) -> Iterator[str]:
    profile = spec.recipe_profile
    runs = schedule(replace(spec.job, paths=tuple(one.path for one in paths)), profile)
    minutes = runs[-1].ends_s / 60.0
    length_mm = sum(one.path.contour.length_mm for one in paths)
    recipe = f"recipe {profile.recipe.name}: {profile.status}"
    if profile.status is RecipeStatus.UNVERIFIED:
        recipe += "; its numbers are assumed, nothing here was tried on a machine: coupons first"
    yield f"; {GENERATOR}"
    yield f"; {gcode_comment(spec.job.name)}: {counted(len(paths), 'path')}, {length_mm:.0f} mm"
    yield f"; machine {machine.name}: {gcode_comment(machine.title)}"
    yield f"; {recipe}"
    yield (
        f"; about {minutes:.1f} min on the paths, without homing and warming up (computed from "
        "assumed speeds)"
    )
    yield "; Z 0 is the top of the film as it lies, with everything that lies below it"
    bed = f"{gcode_number(machine.bed_width_mm.value)} {gcode_number(machine.bed_height_mm.value)}"
    yield f";BED {bed}"
    yield f";TRAVEL {gcode_number(machine.travel_z_mm.value)}"
    if isinstance(machine, KnifeMachine):
        yield f";BLADE {gcode_number(machine.blade_offset_mm.value)}"


def _warm_up(spec: LaserFileSpec, paths: Sequence[StyledPath]) -> Iterator[str]:
    """Yield the heating of tool and bed, and the wait until both are warm."""
    settings = paths[0].path.settings_in(spec.recipe_profile)
    if not isinstance(settings, HotTip):
        return
    tip, bed = settings.seal_temperature_c.value, settings.bed_temperature_c.value
    yield f"M104 S{gcode_number(tip)} ; heat the tip"
    if bed > 0.0:
        yield f"M140 S{gcode_number(bed)} ; heat the bed"
        yield f"M190 S{gcode_number(bed)} ; wait for the bed"
    yield f"M109 S{gcode_number(tip)} ; wait for the tip"
    if settings.preheat_s.value > 0.0:
        yield f"G4 S{gcode_number(settings.preheat_s.value)} ; let everything warm through"


def _cool_down(machine: LiftingMachine, settings: OperationSettings) -> Iterator[str]:
    height, speed = machine.travel_z_mm.value, 60.0 * machine.plunge_mm_s.value
    yield f"G0 Z{gcode_number(4.0 * height)} F{gcode_number(speed)} ; lift"
    if isinstance(settings, HotTip):
        yield "M104 S0 ; cool the tip"
        yield "M140 S0 ; cool the bed"
        # The tip is still hot: it waits away from the film.
        yield _travel(machine, (0.0, machine.bed_height_mm.value))
    yield ";END"
    yield from machine.end_gcode.splitlines() or ["M84 ; release the motors"]
    yield ";END END"


def _seal_lines(
    spec: LaserFileSpec, machine: LiftingMachine, paths: Sequence[StyledPath]
) -> Iterator[str]:
    """Yield seams: the tip comes down on the start, dwells, and lifts at the end alone."""
    profile, celsius = spec.recipe_profile, None
    for number, styled in enumerate(paths, start=1):
        drive = _drive_of(styled.path.settings_in(profile))
        yield _title(number, styled)
        if celsius not in (None, drive.celsius) and drive.celsius is not None:
            yield f"M109 S{gcode_number(drive.celsius)} ; wait for the tip"
        celsius = drive.celsius
        segments = list(styled.path.contour.segments)
        for depth in drive.depths_mm:
            yield _travel(machine, segments[0].start_mm)
            yield _down(machine, depth)
            if drive.dwell_s > 0.0:
                yield f"G4 P{gcode_number(1000.0 * drive.dwell_s)} ; dwell"
            yield from (_move(segment, drive.feed_mm_min) for segment in segments)
            yield _up(machine)


def _cut_lines(
    spec: LaserFileSpec, machine: LiftingMachine, paths: Sequence[StyledPath]
) -> Iterator[str]:
    """Yield cuts of a trailing blade; its heading is known from a short cut on the rim."""
    if not isinstance(machine, KnifeMachine):
        return
    profile, offset = spec.recipe_profile, machine.blade_offset_mm.value
    heading = 0.0
    rim = machine.margin_mm.value / 2.0
    first = paths[0].path.settings_in(profile)
    if offset > 0.0 and isinstance(first, Knife):
        yield ";ORIENT the blade along x, on the rim of the film"
        yield _travel(machine, (rim, rim))
        yield _down(machine, -first.swivel_depth_mm.value)
        ahead = (rim + orientation_mm(machine), rim)
        yield f"G1 {gcode_xy(ahead)} F{gcode_number(60.0 * first.cut_speed_mm_s.value)}"
        yield _up(machine)
    for number, styled in enumerate(paths, start=1):
        settings = styled.path.settings_in(profile)
        drive, contour = _drive_of(settings), styled.path.contour
        shallow = -settings.swivel_depth_mm.value if isinstance(settings, Knife) else 0.0
        yield _title(number, styled)
        for depth in drive.depths_mm:
            moves = list(axis_moves(contour, offset, heading))
            lifted = max(depth, shallow)
            yield _travel(machine, moves[0].segment.start_mm)
            yield _down(machine, lifted if moves[0].swivels else depth)
            yield from _blade_moves(moves, machine, drive.feed_mm_min, (depth, lifted))
            yield _up(machine)
            heading = list(contour.segments)[-1].direction_rad(at_end=True)


def orientation_mm(machine: Machine) -> float:
    """Return the length of the cut that turns a trailing blade along x; 0 without a blade.

    After twelve offsets it has turned to within 1e-5 rad of the way that it is drawn.
    """
    return 12.0 * machine.blade_offset_mm.value if isinstance(machine, KnifeMachine) else 0.0


def _blade_moves(
    moves: Sequence[AxisMove],
    machine: KnifeMachine,
    feed_mm_min: float,
    depths_mm: tuple[float, float],
) -> Iterator[str]:
    """Yield the moves of one pass; in a sharp corner the blade is lifted to swivel."""
    deep, lifted = depths_mm
    least = math.radians(machine.corner_swivel_deg.value)
    z = lifted if moves[0].swivels else deep
    for move in moves:
        wanted = lifted if move.swivels and (abs(move.turn_rad) > least or z == lifted) else deep
        if wanted != z:
            yield _down(machine, wanted)
            z = wanted
        if math.dist(move.segment.start_mm, move.segment.end_mm) > 10.0**-_DECIMALS:
            yield _move(move.segment, feed_mm_min)


_PATHS = {Tool.HOT_TIP: _seal_lines, Tool.KNIFE: _cut_lines}
GCODE_TOOLS = frozenset(_PATHS)
"""Tools that are driven by G-code."""


def _title(number: int, styled: StyledPath) -> str:
    style = styled.style
    return f";PATH {number} {style.layer} {style.rgb} {gcode_comment(styled.path.label)}".rstrip()


def gcode_comment(text: str) -> str:
    """Return a user's text as firmware can skip it: one line of ASCII."""
    return one_line(text).encode("ascii", "replace").decode()


def _travel(machine: LiftingMachine, to_mm: Point) -> str:
    return f"G0 {gcode_xy(to_mm)} F{gcode_number(60.0 * machine.speed_max_mm_s.value)}"


def _down(machine: LiftingMachine, z_mm: float) -> str:
    return f"G1 Z{gcode_number(z_mm)} F{gcode_number(60.0 * machine.plunge_mm_s.value)}"


def _up(machine: LiftingMachine) -> str:
    height, speed = machine.travel_z_mm.value, machine.plunge_mm_s.value
    return f"G0 Z{gcode_number(height)} F{gcode_number(60.0 * speed)}"


def _move(segment: Segment, feed_mm_min: float) -> str:
    end, feed = gcode_xy(segment.end_mm), gcode_number(feed_mm_min)
    if not segment.bulge:
        return f"G1 {end} F{feed}"
    (x, y), (x0, y0) = segment.center_mm, segment.start_mm
    code = "G3" if segment.bulge > 0.0 else "G2"
    return f"{code} {end} I{gcode_number(x - x0)} J{gcode_number(y - y0)} F{feed}"


def gcode_xy(point_mm: Point) -> str:
    """Return a place as words of G-code.

    >>> gcode_xy((1.5, 0.0))
    'X1.5 Y0'
    """
    return f"X{gcode_number(point_mm[0])} Y{gcode_number(point_mm[1])}"


def gcode_number(value: float) -> str:
    """Return a number as G-code has it: no exponent, no digits that say nothing.

    >>> gcode_number(2.50000001)
    '2.5'
    """
    return f"{round(float(value), _DECIMALS) + 0.0:.{_DECIMALS}f}".rstrip("0").rstrip(".")


# --- Reading --------------------------------------------------------------------------------------

_WORD = re.compile(r"([A-Z])(-?\d+(?:\.\d+)?)")
_KNOWN = {
    *("G0", "G1", "G2", "G3", "G4", "G21", "G28", "G90"),
    *("M84", "M104", "M109", "M140", "M190"),
}


@dataclass(slots=True)
class _Reader:
    """A machine that reads G-code: where it is, with its doings so far."""

    at: Point = (math.nan, math.nan)
    z: float = math.inf
    feed: float = 0.0
    celsius: float | None = None
    blade_mm: float = 0.0
    bed: Point = (math.inf, math.inf)
    over_mm: float = math.inf  # heights from here on are over the film
    point: Point = (math.nan, math.nan)  # of a blade: where it cuts
    heading: float = 0.0
    title: tuple[str, str] | None = None  # layer and colour of the path that is read
    passes: list[list[Segment]] = field(default_factory=list)
    found: dict[str, str] = field(default_factory=dict)
    depths: list[float] = field(default_factory=list)
    paths: list[DrawnPath] = field(default_factory=list)
    settings: dict[str, Mapping[str, str]] = field(default_factory=dict)
    odd: list[str] = field(default_factory=list)
    modes: set[str] = field(default_factory=set)

    def begin(self, layer: str, colour: str) -> None:
        """Begin a path."""
        self.end()
        self.title, self.passes, self.depths = (layer, colour), [], []
        heat = {} if self.celsius is None else {"celsius": gcode_number(self.celsius)}
        self.found = {"feed_mm_min": "", "depths_mm": "", "dwell_s": "0", **heat}

    def end(self) -> None:
        """End a path: all its passes must be alike."""
        if self.title is None:
            return
        number = len(self.paths) + 1
        drawn = [part for part in self.passes if part]
        if not drawn:
            self.odd.append(f"a path {number} without a line")
        else:
            contours = [Contour.from_segments(part, closed=False) for part in drawn]
            first = contours[0]
            if any(
                one.points_mm.shape != first.points_mm.shape
                or abs(one.points_mm - first.points_mm).max() > _TOLERANCE_MM
                for one in contours
            ):
                self.odd.append(f"passes of path {number} that differ")
            layer, colour = self.title
            self.paths.append(DrawnPath(layer=layer, colour=colour, contour=first))
            self.found["depths_mm"] = ", ".join(map(gcode_number, self.depths))
            self.settings[f"path {number}"] = self.found
        self.title = None

    def go(self, words: Mapping[str, float], *, fast: bool, bulge_of: int) -> None:
        """Move: over the film, or along a line or arc in it."""
        z = words.get("Z", self.z)
        to = words.get("X", self.at[0]), words.get("Y", self.at[1])
        self.feed = words.get("F", self.feed)
        low = z < self.over_mm and self.z < self.over_mm
        if "Z" in words and ("X" in words or "Y" in words):
            self.odd.append("a move that is level in no plane")
        if any(
            value < -_TOLERANCE_MM or value > most for value, most in zip(to, self.bed, strict=True)
        ):
            self.odd.append(f"a move off the bed, to {to[0]:g}, {to[1]:g}")
        if low and to != self.at:
            if fast:
                self.odd.append("a fast move in the film")
            self._along(
                Segment(start_mm=self.at, end_mm=to, bulge=self._bulge(words, to, bulge_of))
            )
        elif z < self.z and z < self.over_mm:
            self._lowered(z)
        self.at, self.z = to, z

    def _bulge(self, words: Mapping[str, float], to: Point, sense: int) -> float:
        if not sense:
            return 0.0
        x, y = self.at[0] + words["I"], self.at[1] + words["J"]
        radii = math.dist((x, y), self.at), math.dist((x, y), to)
        if abs(radii[0] - radii[1]) > _TOLERANCE_MM:
            self.odd.append("an arc whose ends are not as far from its centre")
        first, last = (math.atan2(b - y, a - x) for a, b in (self.at, to))
        turn = (last - first) % math.tau if sense > 0 else -((first - last) % math.tau)
        return math.tan(turn / 4.0)

    def _lowered(self, z: float) -> None:
        if self.z >= self.over_mm:
            self.passes.append([])
            self.depths.append(z)
            self.point = ahead_mm(self.at, self.heading + math.pi, self.blade_mm)
        elif self.depths:
            self.depths[-1] = min(self.depths[-1], z)

    def _along(self, move: Segment) -> None:
        before, self.point = self.point, move.end_mm
        if self.blade_mm:
            self.point = point_after(move, before, self.blade_mm)
            x, y = move.end_mm[0] - self.point[0], move.end_mm[1] - self.point[1]
            self.heading = math.atan2(y, x)
        if self.title is None:
            return
        self.found["feed_mm_min"] = gcode_number(self.feed)
        if math.dist(before, self.point) > _SAME_MM:
            self.passes[-1].append(Segment(start_mm=before, end_mm=self.point, bulge=move.bulge))


_SAME_MM = 2e-4
"""A blade's point that moves by less rests: rounding."""


def read_gcode(text: str) -> ReadDrawing:
    """Read G-code of ours: what its machine's tool does to the film."""
    reader, own = _Reader(), True
    lines = text.splitlines()
    if not lines or not lines[0].startswith(GCODE_MARK):
        raise UnreadableFileError(
            "G-code text", "not G-code of ours: it does not begin with its mark"
        )
    for line in lines:
        code, _, comment = line.partition(";")
        words = _WORD.findall(code)
        if any(letter == "E" for letter, _ in words):
            reader.odd.append("a word E, which extrudes")
        if not code.strip():
            own = _note(reader, comment, own=own)
        elif own:
            if "".join(f"{letter}{value}" for letter, value in words) != code.replace(" ", ""):
                raise UnreadableFileError("G-code text", f"not G-code of ours: {line!r}")
            _obey(reader, words)
    reader.end()
    if not {"G21", "G90"} <= reader.modes:
        reader.odd.append("no G21 G90")
    return ReadDrawing(
        paths=tuple(reader.paths),
        settings=reader.settings,
        oddities=tuple(dict.fromkeys(reader.odd)),
    )


def _note(reader: _Reader, comment: str, *, own: bool) -> bool:
    """Take in a comment; return whether the lines that follow are ours."""
    words = comment.split()
    match words:
        case ["PATH", _, layer, colour, *_]:
            reader.begin(layer, colour)
        case ["BED", width, height]:
            reader.bed = float(width), float(height)
        case ["TRAVEL", height]:
            reader.over_mm = float(height)
        case ["BLADE", offset]:
            reader.blade_mm = float(offset)
        case ["START" | "END"]:
            reader.end()
            return False
        case ["START" | "END", "END"]:
            return True
    return own


def _obey(reader: _Reader, words: Sequence[tuple[str, str]]) -> None:
    name = "".join(words[0])
    values = {letter: float(value) for letter, value in words[1:]}
    if name not in _KNOWN:
        reader.odd.append(f"a command {name}")
    elif name in ("G21", "G90"):
        reader.modes.add(name)
    elif name == "G4":
        seconds = values.get("S", values.get("P", 0.0) / 1000.0)
        if reader.title is not None:
            reader.found["dwell_s"] = gcode_number(seconds)
    elif name == "M109":
        reader.celsius = values["S"]
        if reader.title is not None:
            reader.found["celsius"] = gcode_number(values["S"])
    elif name in ("G0", "G1", "G2", "G3"):
        sense = {"G2": -1, "G3": 1}.get(name, 0)
        reader.go(values, fast=name == "G0", bulge_of=sense)


GCODE = LaserFormat(
    title="G-code in millimetres",
    use="for the machine itself: it heats, lowers, lifts and cools",
    suffix=".gcode",
    write=gcode_text,
    read=read_gcode,
    tolerance_mm=_TOLERANCE_MM,
    paths=driven_paths,
    settings=path_settings,
    tools=GCODE_TOOLS,
    needs_profile=True,
    whole=False,
)
