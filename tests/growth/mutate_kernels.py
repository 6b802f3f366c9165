"""Change the compiled kernels one place at a time, and check that a test fails.

For the whole table run ``python tests/growth/mutate_kernels.py``, for some rows add a part of
their module's name, such as ``tips``. Kernels run as plain Python, so that nothing is compiled. A
mutant survives where no test fails: then a test is missing.
"""

import os
import signal
import sys
import tempfile
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 300
"""A mutant that never ends is noticed after so long."""

TESTS = {
    "growth.kernel": (
        "growth/test_analytic.py",
        "growth/test_degenerate.py",
        "growth/test_tree_growth.py",
        "growth/test_pressure_stop.py",
        "growth/test_engine_parts.py",
        "growth/test_batch.py",
        "growth/test_twins.py",
    ),
    "growth.contact_kernel": ("growth/test_branch_contact.py", "growth/test_emergence.py"),
    "growth.batch_kernel": ("search/test_design_batch.py", "tasks/test_fast_areas.py"),
    "tasks.areas_kernel": ("tasks/test_fast_areas.py", "tasks/test_reach.py"),
    "tasks.union_kernel": ("tasks/test_union_areas.py",),
    "tasks.tips_kernel": ("tasks/test_anchoring_force.py",),
}
"""Files of tests that hold each kernel, those that fail soonest first."""


class Mutant(NamedTuple):
    """One change: a text that stands once in a module, and what takes its place."""

    module: str
    old: str
    new: str


GROWTH, CONTACT, BATCH = "growth.kernel", "growth.contact_kernel", "growth.batch_kernel"
AREAS, UNION, TIPS = "tasks.areas_kernel", "tasks.union_kernel", "tasks.tips_kernel"

MUTANTS = tuple(
    Mutant(*row)
    for row in (
        # Rules of growth
        (GROWTH, "wall, 2] < -rules.tolerance_rad", "wall, 2] < rules.tolerance_rad"),
        (
            GROWTH,
            "against) <= rules.head_on_half_angle_rad +",
            "against) <= rules.head_on_half_angle_rad -",
        ),
        (
            GROWTH,
            "abs(ux * nx + uy * ny - (uy * tx - ux * ty)) <=",
            "abs(ux * nx + uy * ny - (uy * tx - ux * ty)) >",
        ),
        (GROWTH, "wall, 3] >= 0.0 else -1.0", "wall, 3] <= 0.0 else -1.0"),
        (GROWTH, "first, 2] <= rules.tolerance_rad", "first, 2] <= -0.5"),
        # What a tip meets
        (GROWTH, "return facing >= -rules.tolerance_rad", "return facing <= -rules.tolerance_rad"),
        (GROWTH, "run_up * facing > 4.0", "run_up * facing < 4.0"),
        (GROWTH, "(facing > gentlest)", "(facing < gentlest)"),
        (GROWTH, "(column + (right > 0)) * cell", "(column + (right < 0)) * cell"),
        (GROWTH, "> best[1] + rules.tolerance_mm:", "> 0.5 * best[1]:"),
        (GROWTH, "(above <= tolerance)", "(above >= tolerance)"),
        (GROWTH, "return 0.0 if solid > 0.0", "return 0.0 if solid < 0.0"),
        (GROWTH, "(span > farthest)", "(span < farthest)"),
        (
            GROWTH,
            "right = min(max(int((max(px, x, zx) + margin",
            "right = min(max(int((max(px, x) + margin",
        ),
        # Slides and flights
        (
            GROWTH,
            "(along + math.sqrt(along * along + short))",
            "(math.sqrt(along * along + short) - along)",
        ),
        (GROWTH, "max(0.0, -tip.sense * (ex * qy", "max(0.0, tip.sense * (ex * qy"),
        (
            GROWTH,
            "place = 0.0 if forward else walls.wall[following, 4]",
            "place = walls.wall[following, 4] if forward else 0.0",
        ),
        (GROWTH, "if distance >= left - TIE_STEPS", "if distance >= left + TIE_STEPS"),
        (GROWTH, "if walls.link[wall, 4] != 0:", "if walls.link[wall, 4] == 2:"),
        (GROWTH, "chain_length[pivot - 1] + step", "chain_length[pivot - 1] - step"),
        # Pressure
        (GROWTH, "return turned * held +", "return held +"),
        (
            GROWTH,
            "abs(ix * uy - iy * ux), ix * ux + iy * uy))",
            "abs(ix * uy + iy * ux), ix * ux + iy * uy))",
        ),
        (GROWTH, "at_y, ux, uy) <= film[3]:", "at_y, ux, uy) >= film[3]:"),
        (GROWTH, "film[3] * (1.0 + rules.tie)", "film[3] * (1.0 - rules.tie)"),
        (
            GROWTH,
            "growth.chain_gain[tip.pivot] * turned\n        growth.chain_drawn",
            "growth.chain_gain[tip.pivot]\n        growth.chain_drawn",
        ),
        (GROWTH, "growth.chain_gain[base] = growth.gain[parent]", "growth.chain_gain[base] = 1.0"),
        # Branches, trees and batches
        (GROWTH, "if tip.stop != FULL_LENGTH:", "if tip.stop == FULL_LENGTH:"),
        (
            GROWTH,
            "if _length(dx, dy) > TIE_STEPS * rules.tolerance_mm:",
            "if _length(dx, dy) > 0.0:",
        ),
        (GROWTH, "growth.stop[parent] != NOT_DEPLOYED", "growth.stop[parent] == NOT_DEPLOYED"),
        (GROWTH, "hx * sine + hy * cosine", "hx * sine - hy * cosine"),
        (GROWTH, "vertex_first[one[2] : two[2]]", "vertex_first[one[1] : two[1]]"),
        (GROWTH, "jobs.half_angle[job],", "jobs.half_angle[0],"),
        # Branches that meet
        (CONTACT, "rest = reach * reach - across", "rest = reach * reach + across"),
        (CONTACT, "return max(low, -value / slope), high", "return max(low, value / slope), high"),
        (CONTACT, "laid - along, 1.0 - gain", "laid - along, 1.0 + gain"),
        (
            CONTACT,
            "enter, leave = min(enter, one), max(leave, two)\n    # The end",
            "enter, leave = one, two\n    # The end",
        ),
        (CONTACT, "return min(max(before, apart), enter)", "return max(before, apart) + enter"),
        (CONTACT, "max(radius[one] + radius[other] -", "max(radius[one] -"),
        (CONTACT, "_draw(seed, k) >= emergence", "_draw(seed, k) < emergence"),
        (CONTACT, "work[k, MEETING] <= now + step", "work[k, MEETING] <= now - step"),
        (CONTACT, "share = min(left / size, 1.0)", "share = min(size / left, 1.0)"),
        (
            CONTACT,
            "growth.turn[row] = min(growth.turn[row], turn)",
            "growth.turn[row] = turn + 1.0",
        ),
        # Bookkeeping of batches
        (BATCH, "_evenly(-half, half,", "_evenly(half, -half,"),
        (BATCH, "riding[k] + length[k] * width", "length[k] * width"),
        (BATCH, "first_point[k + job + 1] - 1", "first_point[k + job]"),
        # Strips and cells
        (AREAS, "free[row, column + 1] -= part", "free[row, column + 1] += part"),
        (AREAS, "slope[row, column + 1] -= part", "slope[row, column + 1] += part"),
        (AREAS, "(piece[0, k] > reached)", "(piece[0, k] < reached)"),
        (AREAS, "if x_before < x or", "if x_before > x or"),
        (
            AREAS,
            "max(radius + 0.5 - math.sqrt(away), 0.0)",
            "max(radius - 0.5 - math.sqrt(away), 0.0)",
        ),
        (AREAS, "one, two = min(one, ax + dx - half)", "one, two = min(one, ax + dx + half)"),
        # Lines of sight
        (AREAS, "(max(x_one, x_two) + reach - grid[0])", "(max(x_one, x_two) - reach - grid[0])"),
        (AREAS, "tip[0] += along * ux - aside * uy", "tip[0] += along * ux + aside * uy"),
        (AREAS, "angle if angle > 0.0 else", "angle if angle < 0.0 else"),
        (AREAS, "if ax * by - ay * bx > 0.0 and", "if ax * by - ay * bx < 0.0 and"),
        (AREAS, "(share - 1.0) / (share - other_share)", "(share - 1.0) / (share + other_share)"),
        (AREAS, "max(begin, two) if one <= begin", "max(begin, two) if one > begin"),
        (AREAS, "right[i] - max(left[i], reached), 0.0)", "right[i] - left[i], 0.0)"),
        # Unions of polygons
        (UNION, "if within >= 1.0 if is_free", "if within > 1.0 if is_free"),
        (
            UNION,
            "edge[count, STEP] = -1.0 if up else 1.0",
            "edge[count, STEP] = 1.0 if up else -1.0",
        ),
        (UNION, "        if not first:\n", "        if first:\n"),
        (UNION, "if doubled < 0.0:", "if doubled > 0.0:"),
        (
            UNION,
            "if row == max(begin, _first_row(free[e, Y]",
            "if row == min(begin, _first_row(free[e, Y]",
        ),
        # Anchoring
        (
            TIPS,
            "total[first + k] += total[first + above]",
            "total[first + k] += own[first + above]",
        ),
        (TIPS, "if (ux != 0.0) | (uy != 0.0):", "if True:"),
        (TIPS, "if held[this] > limit[this]:", "if held[this] < limit[this]:"),
        (TIPS, "capped[j] += 1.0", "capped[j] = 1.0"),
        (TIPS, "if abs(place) <= tolerance:", "if abs(place) > tolerance:"),
        (TIPS, "1 if side_b < side_a else -1", "1 if side_b > side_a else -1"),
        (TIPS, "if to_column < to_row:", "if to_column > to_row:"),
        (TIPS, "if nearest <= min(to_column, to_row):", "if nearest < math.inf:"),
    )
)


def is_noticed(mutant: Mutant) -> bool:
    """Tell whether a test fails in a process where a kernel is changed."""
    room, name = mutant.module.split(".")
    with tempfile.TemporaryDirectory() as folder:
        source = (ROOT / "vinefab" / room / f"{name}.py").read_text()
        if source.count(mutant.old) != 1:
            raise SystemExit(
                f"{mutant.module}: {mutant.old!r} stands {source.count(mutant.old)} times"
            )
        Path(folder, f"{name}.py").write_text(source.replace(mutant.old, mutant.new))
        process = os.fork()
        if process == 0:
            signal.alarm(SECONDS)
            silence = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silence, 1)
            os.dup2(silence, 2)
            import_module(f"vinefab.{room}").__path__.insert(0, folder)
            files = [str(ROOT / "tests" / file) for file in TESTS[mutant.module]]
            os._exit(int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *files])))
        _, status = os.waitpid(process, 0)
    ended = os.waitstatus_to_exitcode(status)
    if ended not in {pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED, -signal.SIGALRM}:
        raise SystemExit(f"{mutant.module}: the tests ended with {ended}")
    return ended != pytest.ExitCode.OK


def main() -> int:
    """Print every mutant that survived, and how many there are."""
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    sys.path.insert(0, str(ROOT))
    import_module("vinefab.tasks.evaluate")  # once, not in every process
    some = [mutant for mutant in MUTANTS if all(word in mutant.module for word in sys.argv[1:])]
    left = [mutant for mutant in some if not is_noticed(mutant)]
    for mutant in left:
        sys.stdout.write(f"survived: {mutant.module}: {mutant.old} -> {mutant.new}\n")
    sys.stdout.write(f"{len(some)} mutants of kernels, {len(left)} survived\n")
    return 1 if left or not some else 0


if __name__ == "__main__":
    sys.exit(main())
