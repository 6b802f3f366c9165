"""A map in a few lines: its size, its starts and targets, and whether its unit may be another."""

from vinefab.core.plain_text import counted
from vinefab.model.map import Map
from vinefab.model.start import area_notes, start_words

_MOST_TARGETS = 10
"""Of a map, that its summary names."""


def map_summary(world: Map) -> tuple[str, ...]:
    """Return the size of a map, its starts and its oddities."""
    sides = [f"{one:.0f}" if one >= 100.0 else f"{one:.3g}" for one in world.size_mm]
    lines = [
        f"{world.name}: {' x '.join(sides)} mm, {counted(len(world.obstacles), 'obstacle')}, "
        f"{counted(world.wall_count, 'wall')}, free area {world.free_space.area / 1e6:.4g} m2"
    ]
    starts = world.starts if any(one.area for one in world.starts) else world.starts[:1]
    lines += [f"start: {start_words(start)}" for start in starts]
    lines += [f"target: {one.name} at {one.place_text}" for one in world.targets[:_MOST_TARGETS]]
    lines += [f"note: {note}" for note in [*import_notes(world), *area_notes([world])]]
    return tuple(lines)


PLAUSIBLE_MM = 60.0, 20_000.0
"""Longer sides of maps that robots are made for; others may be of another unit."""

_LIKELY_MM = 100.0, 10_000.0
_UNITS_MM = {1000.0: "metres", 25.4: "inches", 10.0: "centimetres", 1.0: "millimetres",
             0.1: "tenths of millimetres", 0.01: "hundredths of millimetres",
             0.001: "micrometres"}  # fmt: skip


_MODELS_MM = tuple(digit * 10.0**power for power in range(3, -7, -1) for digit in (5, 2, 1))
_MODEL_SIZE_MM = 300.0, 3000.0
"""Scales of models in mm per unit of the source, and longer sides of models."""


def import_notes(world: Map) -> list[str]:
    """Return the notes of a map: those of its import, and whether its unit may be another."""
    told = world.facts.get("notes", ())
    return [*map(str, told if isinstance(told, list | tuple) else ()), *size_notes(world)]


def size_notes(world: Map) -> list[str]:
    """Return a note on a map that is so small or large that its unit may be another one."""
    longer_mm, (least_mm, most_mm) = max(world.size_mm), PLAUSIBLE_MM
    if world.seed is not None or least_mm <= longer_mm <= most_mm:  # a generator knows its unit
        return []
    taken = world.facts.get("scale_mm_per_unit", 1.0)
    scale = float(taken) if isinstance(taken, int | float) else 1.0
    width, height = (side_mm / scale for side_mm in world.size_mm)  # in units of the source
    said = f"this map is {world.size_mm[0]:.6g} x {world.size_mm[1]:.6g} mm"
    if longer_mm > most_mm and world.facts.get("unit_known_by") in ("file", "program", "option"):
        models = [
            f"{factor:g} ({width * factor:.4g} x {height * factor:.4g} mm)"
            for factor in _MODELS_MM
            if _MODEL_SIZE_MM[0] <= max(width, height) * factor <= _MODEL_SIZE_MM[1]
        ]
        if models:
            return [f"{said}: for a model on a table --scale-mm-per-unit {' or '.join(models)}"]
    drawn = "" if scale == 1.0 else f", drawn as {width:.6g} x {height:.6g}"
    others = [
        f"{factor:g} if its unit is {unit} ({width * factor:.4g} x {height * factor:.4g} mm)"
        for factor, unit in _UNITS_MM.items()
        if _LIKELY_MM[0] <= max(width, height) * factor <= _LIKELY_MM[1] and factor != scale
    ]
    if not others:
        return [f"{said}{drawn}: is that its unit? vinefab map import has --scale-mm-per-unit"]
    return [f"{said}{drawn}: vinefab map import --scale-mm-per-unit {', '.join(others)}"]
