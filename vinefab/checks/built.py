"""Rules about what came out: widths in the laser's paths, and the files read again."""

from vinefab.checks.marks import mark_branches, middle_mm
from vinefab.checks.rule import Hit, Limits, Looked, NotLooked, Rule
from vinefab.checks.sides import excesses_mm
from vinefab.checks.subject import Subject
from vinefab.checks.webs import whose
from vinefab.model.job import Operation
from vinefab.model.laser import OperationSettings


def look_built_width(subject: Subject, limits: Limits) -> Looked | NotLooked:
    """VF-W04: both sides of a branch, less seam and kerf, leave the designed lumen between them."""
    if subject.job is None or subject.profile is None:
        return NotLooked(reason="needs a recipe, for seam and kerf")
    operation = Operation.WELDCUT if subject.job.along(Operation.WELDCUT) else Operation.WELD
    settings = subject.profile.settings(operation)
    offset_mm = beam_offset_mm(settings) if operation is Operation.WELDCUT else weld_mm(settings)
    paths = subject.own(operation)
    checked, worst = 0, dict[int, tuple[float, str]]()
    for path in paths:
        for row, excess_mm in excesses_mm(subject, path.contour, offset_mm).items():
            checked += 1
            if abs(excess_mm) > abs(worst.get(row, (0.0, ""))[0]):
                worst[row] = excess_mm, whose(path, paths)
    hits = []
    for row, (excess_mm, of) in sorted(worst.items()):
        breach = limits.most(abs(excess_mm))
        if breach:
            hits.append(_too_wide(subject, row, excess_mm, of, breach.limit))
    return Looked(checked=checked, hits=tuple(hits))


def _too_wide(subject: Subject, row: int, excess_mm: float, of: str, limit: float) -> Hit:
    layout = subject.layout
    built_mm = float(layout.width_mm[row] + layout.end_width_mm[row]) / 2.0 + excess_mm
    return Hit(
        message=f"the branch{of} comes out {built_mm:.2f} mm wide in the paths: its joint took "
        "its sides, or their seam and kerf are not the recipe's",
        measured=abs(excess_mm),
        limit=limit,
        branches=subject.ids(row),
        at_mm=middle_mm(layout, row),
        marker=mark_branches(layout, [row]),
    )


def beam_offset_mm(settings: OperationSettings) -> float:
    """Return how far outside the lumen the beam runs to cut and seal in one pass: s + k/2."""
    return settings.seam_width_mm.value + settings.kerf_mm.value / 2.0


def weld_mm(settings: OperationSettings) -> float:
    """Return how far outside the lumen the middle of a seam runs that is welded alone: s/2."""
    return settings.seam_width_mm.value / 2.0


def look_readback(subject: Subject, _: Limits) -> Looked | NotLooked:
    """VF-X01: every file that was written says, read again, what it was meant to say."""
    if subject.readback is None:
        return NotLooked(reason="no file was written and read back")
    hits = [
        Hit(message=f"{name}: {problem}", aspect=name)
        for name, problems in subject.readback.items()
        for problem in problems
    ]
    return Looked(checked=len(subject.readback), hits=tuple(hits))


BUILT_WIDTH = Rule(
    id="VF-W04",
    title="width as built, against the design",
    unit="mm",
    limits={"error": 0.1},
    reason="a forgotten seam and kerf offset narrows an 8 mm branch by 6 to 12 % (computed)",
    look=look_built_width,
)
READBACK = Rule(
    id="VF-X01",
    title="exported files, read again, equal the model",
    reason="programs read files, not intentions",
    look=look_readback,
)
