"""Designs as plain values, to hand to another process and to keep."""

from collections.abc import Mapping
from typing import Any

from vinefab.model.design import Build, Design, Level, Pouch


def plain_design(design: Design) -> dict[str, Any]:
    """Return a design's shape and build; its origin and waivers are left out."""
    build, pouch = design.build, design.build.pouch
    return {
        "name": design.name,
        "trunk_length_mm": design.trunk_length_mm,
        "levels": [
            {
                "branches": level.branches,
                "length_mm": level.length_mm,
                "fan_rad": level.fan_rad,
                "growth": level.growth,
            }
            for level in design.levels
        ],
        "widths_mm": list(build.widths_mm),
        "fillet_mm": list(build.fillet_mm),
        "tail_mm": build.tail_mm,
        "pressure_kpa": build.pressure_kpa,
        "pouch": None
        if pouch is None
        else {
            name: getattr(pouch, name) for name in ("shape", "radius_mm", "length_mm", "width_mm")
        },
    }


def design_from(plain: Mapping[str, Any]) -> Design:
    """Return the design of `plain_design`."""
    pouch = plain["pouch"]
    return Design(
        name=plain["name"],
        trunk_length_mm=plain["trunk_length_mm"],
        levels=tuple(Level(**level) for level in plain["levels"]),
        build=Build(
            widths_mm=tuple(plain["widths_mm"]),
            fillet_mm=tuple(plain["fillet_mm"]),
            tail_mm=plain["tail_mm"],
            pressure_kpa=plain["pressure_kpa"],
            pouch=None if pouch is None else Pouch(**pouch),
        ),
    )


def plain_vine(length_mm: float) -> Design:
    """Return an unbranched robot."""
    return Design(name="plain_vine", trunk_length_mm=length_mm, build=Build.standard(1))


def words(design: Design) -> str:
    """Return the size of a design in a few words."""
    fans = " x ".join(str(level.branches) for level in design.levels) or "no branches"
    length_m = total_length_mm(design) / 1000.0
    return f"{design.branch_count} branches ({fans}), {length_m:.1f} m of film in all"


def total_length_mm(design: Design) -> float:
    """Return the planned length of all branches together."""
    total, parents = design.trunk_length_mm, 1
    for level in design.levels:
        parents *= level.branches
        total += parents * level.length_mm * (1.0 + level.growth) / 2.0
    return total
