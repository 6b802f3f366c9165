"""What a pattern and its joints are, level by level: the tables of every page that shows them."""

from collections.abc import Iterator
from functools import partial

from vinefab.core.validation import Floats
from vinefab.core.view import Notes, Number, Rows, Value
from vinefab.inflation.pattern import Pattern
from vinefab.model.tree import child_lengths_mm

_SHOWN = partial(Number, form="z.1f", decimals=3)
_PLAIN = partial(Number, form=".2f", decimals=4)
_NOTHING = Number(None)


def pattern_blocks(
    pattern: Pattern, in_robot_deg: dict[int, Floats] | None = None
) -> Iterator[Rows | Notes]:
    """Yield what is cut for what is designed, what each joint becomes, and what cannot be.

    Parameters
    ----------
    in_robot_deg
        Mean angle of each child within the whole robot, by the level of the children, if that was
        simulated.
    """
    yield pattern_table(pattern, in_robot_deg)
    yield joint_table(pattern)
    yield Notes(tuple(f"{one}." for one in pattern.problems), "problems")


def pattern_table(pattern: Pattern, in_robot_deg: dict[int, Floats] | None = None) -> Rows:
    """Return angles and lengths of each kind of child as designed, as cut and as expected.

    Parameters
    ----------
    in_robot_deg
        As of `pattern_blocks`.
    """
    trees = (pattern.design, pattern.flat, pattern.deployed)
    whole, means_deg = in_robot_deg is not None, in_robot_deg or {}
    trunks = [_SHOWN(tree.trunk_length_mm) for tree in trees]
    rows: list[tuple[Value, ...]] = [
        (1, 1, *(_NOTHING,) * 3, *((_NOTHING,) if whole else ()), *trunks, _NOTHING)
    ]
    for place, joint in enumerate(pattern.joints):
        if (found := joint.found) is None:
            continue
        angles = zip(joint.wanted_deg, found.flat.angles_deg, found.deployed_deg, strict=True)
        lengths = zip(*(child_lengths_mm(tree.levels[place]) for tree in trees), strict=True)
        for child, (degrees, sizes_mm) in enumerate(zip(angles, lengths, strict=True)):
            here = (_SHOWN(float(means_deg[joint.level][child])),) if whole else ()
            aside = _SHOWN(joint.width_mm * found.side_offsets[child])
            rows.append(
                (joint.level, child + 1, *map(_SHOWN, degrees), *here,
                 *(_SHOWN(float(one)) for one in sizes_mm), aside)
            )  # fmt: skip
    within = "of the joint alone, and the mean within the whole robot" if whole else "of the joint"
    return Rows(
        caption="Branches of each level: angles to the parent in deg (positive: left), lengths in "
        f"mm; as designed, as cut, as expected {within} ({pattern.standing}; triangles are good "
        "for 0.6 deg)",
        headings=("level", "child", "angle designed", "cut", "expected",
                  *(("in the robot",) if whole else ()),
                  "length designed", "cut", "expected", "aside"),
        rows=tuple(rows),
        key="branches",
        keys=("level", "child", "designed_deg", "cut_deg", "expected_deg",
              *(("in_robot_deg",) if whole else ()),
              "designed_mm", "cut_mm", "expected_mm", "aside_mm"),
    )  # fmt: skip


def joint_table(pattern: Pattern) -> Rows:
    """Return sensitivity, load and passage of each kind of joint."""
    return Rows(
        caption="Joints: change of the deployed angle over that of the flat one, load that "
        "opens the weld in a crotch over that of the trunk's straight seam, largest ball that "
        "passes into a child over the child's tube (simulated)",
        headings=("children on level", "joints", "parent mm", "sensitivity", "crotch load",
                  "passage"),
        rows=tuple(
            (joint.level, joint.count, Number(joint.width_mm, form=".1f"),
             _PLAIN(joint.found.sensitivity), _PLAIN(joint.found.crotch_load),
             _PLAIN(joint.found.passage))
            for joint in pattern.joints
            if joint.found is not None
        ),
        key="joints",
        keys=("level", "count", "parent_mm", "sensitivity", "crotch_load", "passage"),
    )  # fmt: skip
