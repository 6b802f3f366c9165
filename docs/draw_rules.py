"""Draw every design rule: a case that breaks it, a case that keeps it, and the measured value.

`docs/draw_pictures.py` writes the files. Shapes are those that vinefab makes of a design: outline,
paths of the laser, pieces, parts of a rig. Each rule is run on both sides: one that does not fire
on the first, or fires on the second, is an error here.
"""

from collections.abc import Callable
from dataclasses import dataclass

import rule_drawings as drawn
from rule_sketch import Sketch, picture, short_number
from rule_subjects import (
    CROSSING,
    corridor,
    design,
    inflated,
    mark_speed,
    material,
    near,
    of,
    open_block,
    path,
    pieced,
    profile,
    quantity,
    recipe,
    rigged,
    sealed_across,
    seamed,
    square,
    tipped,
    with_paths,
)

from vinefab.fabrication.rules.catalog import RULES, run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Collar, PieceSettings, Pouch
from vinefab.model.finding import Finding
from vinefab.model.job import Operation
from vinefab.model.laser import RecipeStatus


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleScene:
    """What is drawn of a rule."""

    wrong: Callable[[], Subject]
    right: Callable[[], Subject]
    draw: Callable[[Subject, Sketch], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """One half of a picture, with the finding of the rule there."""

    kind: str  # ``wrong`` or ``right``
    finding: Finding | None
    sketch: Sketch


def rule_pictures() -> dict[str, str]:
    """Return the picture of every rule by its name."""
    return {f"rules/{rule}.svg": rule_picture(rule, sides_of(rule)) for rule in SCENES}


def sides_of(rule: str) -> list[Side]:
    """Return the case that breaks a rule and the case that keeps it; the rule was run on both."""
    scene, sides = SCENES[rule], []
    for kind, build in (("wrong", scene.wrong), ("right", scene.right)):
        subject, sketch = build(), Sketch()
        found = [one for one in run_checks(subject, only={rule}).findings if one.rule == rule]
        if bool(found) != (kind == "wrong"):
            raise ValueError(f"{rule}: its {kind} side is not {kind}: {found}")
        scene.draw(subject, sketch)
        sides.append(Side(kind=kind, finding=found[0] if found else None, sketch=sketch))
    return sides


def rule_picture(rule: str, sides: list[Side]) -> str:
    """Return the picture of a rule."""
    return picture(
        f"{rule}: {RULES[rule].broken}; then {RULES[rule].title}",
        [(one.kind, _verdict(one.finding) if one.finding else "kept", one.sketch) for one in sides],
    )


def _verdict(finding: Finding) -> str:
    """Return the severity of a finding, and the limit that it breaks."""
    if not finding.limit:  # there is none, or it is the bare edge between holding and not
        return finding.severity.value
    return f"{finding.severity.value}: limit {short_number(finding.limit)} {finding.unit}".rstrip()


SCENES = {
    "VF-T01": RuleScene(wrong=of((2, 0.09, 90.0)), right=of((2, 60.0, 90.0)), draw=drawn.draw_tree),
    "VF-T02": RuleScene(wrong=near(138.0), right=near(112.0), draw=drawn.draw_crossing),
    "VF-T03": RuleScene(wrong=near(138.0), right=near(112.0), draw=drawn.draw_pair),
    "VF-T04": RuleScene(
        wrong=of(widths_mm=(4.0,)), right=of(widths_mm=(12.0,)), draw=drawn.draw_mouth
    ),
    "VF-W01": RuleScene(
        wrong=of((2, 70.0, 60.0), widths_mm=(24.0, 4.0)),
        right=of((2, 70.0, 60.0), widths_mm=(24.0, 12.0)),
        draw=drawn.draw_leaf_width,
    ),
    "VF-W02": RuleScene(
        wrong=of((2, 110.0, 70.0), widths_mm=(26.0, 24.0)),
        right=of((2, 110.0, 70.0), widths_mm=(40.0, 20.0)),
        draw=drawn.draw_ratio,
    ),
    "VF-W03": RuleScene(
        wrong=of((20, 200.0, 320.0)), right=of((4, 200.0, 120.0)), draw=drawn.draw_packing
    ),
    "VF-W04": RuleScene(wrong=seamed(-0.4), right=seamed(0.0), draw=drawn.draw_built_width),
    "VF-C01": RuleScene(wrong=near(126.5), right=near(118.0), draw=drawn.draw_pair),
    "VF-C02": RuleScene(
        wrong=of((2, 200.0, 10.0)), right=of((2, 200.0, 40.0)), draw=drawn.draw_angle
    ),
    "VF-C03": RuleScene(
        wrong=of((2, 40.0, 60.0)), right=of((2, 80.0, 60.0)), draw=drawn.draw_crotch
    ),
    "VF-C04": RuleScene(
        wrong=of((2, 200.0, 60.0), fillet_mm=(0.5,)),
        right=of((2, 200.0, 60.0), fillet_mm=(6.0,)),
        draw=drawn.draw_fillet,
    ),
    "VF-C05": RuleScene(
        wrong=of((2, 90.0, 80.0), (2, 45.0, 280.0), fillet_mm=(38.0, 3.0)),
        right=of((2, 90.0, 80.0), (2, 45.0, 280.0), fillet_mm=(12.0, 3.0)),
        draw=drawn.draw_foreign_fillet,
    ),
    "VF-C06": RuleScene(
        wrong=of((2, 160.0, 240.0)), right=of((2, 160.0, 100.0)), draw=drawn.draw_turn
    ),
    "VF-C07": RuleScene(
        wrong=of((2, 200.0, 40.0), pouch=Pouch(shape="round", radius_mm=66.8)),
        right=of((2, 200.0, 40.0), pouch=Pouch(shape="round", radius_mm=45.0)),
        draw=drawn.draw_pouch,
    ),
    "VF-P01": RuleScene(
        wrong=of(widths_mm=(60.0,), pressure_kpa=40.0),
        right=of(widths_mm=(30.0,), pressure_kpa=20.0),
        draw=drawn.draw_burst,
    ),
    "VF-P02": RuleScene(
        wrong=of(widths_mm=(10.0,), pressure_kpa=90.0),
        right=of(widths_mm=(10.0,), pressure_kpa=40.0),
        draw=drawn.draw_rating,
    ),
    "VF-P03": RuleScene(
        wrong=of((2, 200.0, 60.0), widths_mm=(100.0, 11.0)),
        right=of((2, 200.0, 60.0), widths_mm=(40.0, 30.0)),
        draw=drawn.draw_window,
    ),
    "VF-P04": RuleScene(
        wrong=of(pressure_kpa=70.0), right=of(pressure_kpa=20.0), draw=drawn.draw_strain
    ),
    "VF-P05": RuleScene(wrong=seamed(-0.25), right=seamed(0.0), draw=drawn.draw_seam),
    "VF-I01": RuleScene(
        wrong=inflated((2, 200.0, 50.0), compensation="none"),
        right=inflated((2, 200.0, 50.0)),
        draw=drawn.draw_deployed,
    ),
    "VF-I02": RuleScene(
        wrong=inflated((4, 200.0, 44.0)),
        right=inflated((2, 200.0, 44.0)),
        draw=drawn.draw_sensitivity,
    ),
    "VF-I03": RuleScene(
        wrong=inflated((3, 150.0, 130.0), fillet_mm=(4.0,)),
        right=inflated((3, 150.0, 130.0), fillet_mm=(13.0,), pressure_kpa=14.0),
        draw=drawn.draw_crotch_load,
    ),
    "VF-I04": RuleScene(
        wrong=inflated((2, 100.0, 60.0), (2, 90.0, 130.0)),
        right=inflated((2, 100.0, 60.0), (2, 90.0, 76.0)),
        draw=drawn.draw_bodies,
    ),
    "VF-B01": RuleScene(wrong=of(tail_mm=90.0), right=of(tail_mm=200.0), draw=drawn.draw_tail),
    "VF-B02": RuleScene(
        wrong=of(widths_mm=(110.0,)),
        right=of(widths_mm=(110.0,), collar=Collar(clamp_diameter_mm=40.0)),
        draw=drawn.draw_clamp,
    ),
    "VF-B03": RuleScene(wrong=of(trunk_mm=150.0), right=of(trunk_mm=400.0), draw=drawn.draw_reach),
    "VF-J01": RuleScene(
        wrong=pieced(*CROSSING, cut=PieceSettings(lap_mm=90.0)),
        right=pieced(*CROSSING),
        draw=drawn.draw_sleeve_room,
    ),
    "VF-J02": RuleScene(
        wrong=pieced(*CROSSING, cut=PieceSettings(most=1)),
        right=pieced(*CROSSING),
        draw=drawn.draw_pieces,
    ),
    "VF-J03": RuleScene(
        wrong=pieced(*CROSSING, widths_mm=(40.0, 34.0, 26.0), pressure_kpa=80.0),
        right=pieced(*CROSSING, pressure_kpa=20.0),
        draw=drawn.draw_lap,
    ),
    "VF-J04": RuleScene(
        wrong=pieced(*CROSSING, widths_mm=(12.0, 12.0, 8.0)),
        right=pieced(*CROSSING, widths_mm=(60.0, 24.0, 14.0)),
        draw=drawn.draw_lap_packing,
    ),
    "VF-J05": RuleScene(
        wrong=pieced(*CROSSING, unmarked="socket B"),
        right=pieced(*CROSSING),
        draw=drawn.draw_labels,
    ),
    "VF-J06": RuleScene(
        wrong=pieced(*CROSSING, cut=PieceSettings(ease_mm=14.0)),
        right=pieced(*CROSSING),
        draw=drawn.draw_ease,
    ),
    "VF-S01": RuleScene(
        wrong=of((2, 700.0, 90.0), pouch=Pouch(shape="round", radius_mm=310.0)),
        right=of((2, 700.0, 180.0)),
        draw=drawn.draw_bed,
    ),
    "VF-S02": RuleScene(
        wrong=of((3, 1100.0, 200.0), trunk_mm=900.0),
        right=of((3, 1100.0, 60.0), trunk_mm=900.0),
        draw=drawn.draw_roll,
    ),
    "VF-L01": RuleScene(
        wrong=with_paths(away_mm=1.0), right=with_paths(away_mm=5.0), draw=drawn.draw_mark
    ),
    "VF-L02": RuleScene(
        wrong=with_paths(
            path(Operation.CUT, [[500.0, 500.0], [520.0, 500.0]]),
            path(Operation.CUT, [[510.0, 500.0], [530.0, 500.0]]),
        ),
        right=with_paths(
            path(Operation.CUT, [[500.0, 500.0], [512.0, 500.0]]),
            path(Operation.CUT, [[518.0, 500.0], [530.0, 500.0]]),
        ),
        draw=drawn.draw_twice,
    ),
    "VF-L03": RuleScene(
        wrong=with_paths(square(400.0, 500.0), square(425.0, 475.0)),
        right=with_paths(square(425.0, 475.0), square(400.0, 500.0)),
        draw=drawn.draw_order,
    ),
    "VF-L04": RuleScene(
        wrong=material(ply_mm=quantity(0.06)),
        right=material(ply_mm=quantity(0.0375)),
        draw=drawn.draw_ply,
    ),
    "VF-L05": RuleScene(wrong=mark_speed(600.0), right=mark_speed(300.0), draw=drawn.draw_machine),
    "VF-L06": RuleScene(
        wrong=recipe(status=RecipeStatus.UNVERIFIED),
        right=recipe(status=RecipeStatus.COUPON_OK),
        draw=drawn.draw_status,
    ),
    "VF-L07": RuleScene(wrong=tipped(0.3), right=tipped(3.0), draw=drawn.draw_bend),
    "VF-L08": RuleScene(wrong=sealed_across, right=of(), draw=drawn.draw_open_mouth),
    "VF-X01": RuleScene(
        wrong=lambda: Subject.of(
            design((2, 120.0, 90.0)),
            profile(),
            readback={"outline.dxf": ("area differs by 10 %",)},
        ),
        right=lambda: Subject.of(design((2, 120.0, 90.0)), profile(), readback={"outline.dxf": ()}),
        draw=drawn.draw_readback,
    ),
    "VF-R01": RuleScene(
        wrong=rigged(problems=tuple(open_block().form_problems())),
        right=rigged(),
        draw=drawn.draw_solid,
    ),
    "VF-R02": RuleScene(
        wrong=rigged(size_mm=(260.0, 120.0, 63.0)), right=rigged(), draw=drawn.draw_fits
    ),
    "VF-R03": RuleScene(wrong=corridor(18.0), right=corridor(34.0), draw=drawn.draw_corridor),
    "VF-R04": RuleScene(
        wrong=rigged(height_mm=18.0), right=rigged(height_mm=40.0), draw=drawn.draw_height
    ),
}
