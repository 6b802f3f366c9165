"""vinefab: design, simulate, optimize and make branching vine robots.

``import vinefab as vf`` gives the public names, each loaded when first used::

    design = vf.Design.read("grid_explorer")
    world = vf.maps.grid(seed=3)
    deployment = design.grow(world)
    vf.score(design, task="coverage", maps=[world], poses=3)
    vf.fabricate(design, out="package", allow_uncalibrated=True)

Lengths are millimetres, angles degrees where a function takes them, pressures kPa. A design, map,
recipe or printer may be given as an object, a path or a name; a pose as ``(x_mm, y_mm,
heading_deg)``. What is not in ``__all__`` may change at any time.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from vinefab.core.version import __version__ as __version__

__all__ = [
    "AimResult",
    "BadInputError",
    "Build",
    "CheckReport",
    "Collar",
    "Contour",
    "Deployment",
    "Design",
    "DesignComparison",
    "Evaluation",
    "EvaluationSettings",
    "ExportRefusedError",
    "Finding",
    "Level",
    "Map",
    "MapInfo",
    "MapSettings",
    "PartSettings",
    "PhotoReport",
    "Pose",
    "Pouch",
    "ProfileNumbers",
    "ProposedFix",
    "Rule",
    "RunListing",
    "RunResult",
    "RunSettings",
    "Score",
    "SearchSettings",
    "Severity",
    "Start",
    "Stop",
    "VinefabError",
    "WrittenFolder",
    "WrittenReport",
    "aim",
    "calibrate",
    "check",
    "compare",
    "coupon",
    "designs",
    "examples",
    "fabricate",
    "fit_observations",
    "fix",
    "maps",
    "new",
    "observe",
    "optimize",
    "printers",
    "profile",
    "recipes",
    "report",
    "rig",
    "rules",
    "runs",
    "score",
]

_HOMES = {
    "vinefab.api": (
        "PhotoReport",
        "ProposedFix",
        "WrittenFolder",
        "WrittenReport",
        "aim",
        "calibrate",
        "check",
        "compare",
        "coupon",
        "designs",
        "examples",
        "fabricate",
        "fit_observations",
        "fix",
        "new",
        "observe",
        "optimize",
        "printers",
        "profile",
        "recipes",
        "report",
        "rules",
        "runs",
        "score",
    ),
    "vinefab.core.errors": ("BadInputError", "ExportRefusedError", "VinefabError"),
    "vinefab.fabrication.profile_listing": ("ProfileNumbers",),
    "vinefab.fabrication.rules.rule": ("Rule",),
    "vinefab.model.deployment": ("Deployment", "Stop"),
    "vinefab.model.design": ("Build", "Collar", "Design", "Level", "Pouch"),
    "vinefab.model.finding": ("CheckReport", "Finding", "Severity"),
    "vinefab.model.map": ("Map", "Pose", "Start"),
    "vinefab.model.outline": ("Contour",),
    "vinefab.model.score": ("Evaluation", "Score"),
    "vinefab.prediction.aiming": ("AimResult",),
    "vinefab.prediction.comparison": ("DesignComparison",),
    "vinefab.prediction.map_info": ("MapInfo",),
    "vinefab.search.record.result": ("RunResult",),
    "vinefab.search.run_pages": ("RunListing",),
    "vinefab.search.settings": (
        "EvaluationSettings",
        "MapSettings",
        "PartSettings",
        "RunSettings",
        "SearchSettings",
    ),
}
"""The module of each public name; ``maps`` and ``rig`` are rooms of their own."""

if TYPE_CHECKING:
    from vinefab import maps as maps
    from vinefab.api import PhotoReport as PhotoReport
    from vinefab.api import ProposedFix as ProposedFix
    from vinefab.api import WrittenFolder as WrittenFolder
    from vinefab.api import WrittenReport as WrittenReport
    from vinefab.api import aim as aim
    from vinefab.api import calibrate as calibrate
    from vinefab.api import check as check
    from vinefab.api import compare as compare
    from vinefab.api import coupon as coupon
    from vinefab.api import designs as designs
    from vinefab.api import examples as examples
    from vinefab.api import fabricate as fabricate
    from vinefab.api import fit_observations as fit_observations
    from vinefab.api import fix as fix
    from vinefab.api import new as new
    from vinefab.api import observe as observe
    from vinefab.api import optimize as optimize
    from vinefab.api import printers as printers
    from vinefab.api import profile as profile
    from vinefab.api import recipes as recipes
    from vinefab.api import report as report
    from vinefab.api import rig as rig
    from vinefab.api import rules as rules
    from vinefab.api import runs as runs
    from vinefab.api import score as score
    from vinefab.core.errors import BadInputError as BadInputError
    from vinefab.core.errors import ExportRefusedError as ExportRefusedError
    from vinefab.core.errors import VinefabError as VinefabError
    from vinefab.fabrication.profile_listing import ProfileNumbers as ProfileNumbers
    from vinefab.fabrication.rules.rule import Rule as Rule
    from vinefab.model.deployment import Deployment as Deployment
    from vinefab.model.deployment import Stop as Stop
    from vinefab.model.design import Build as Build
    from vinefab.model.design import Collar as Collar
    from vinefab.model.design import Design as Design
    from vinefab.model.design import Level as Level
    from vinefab.model.design import Pouch as Pouch
    from vinefab.model.finding import CheckReport as CheckReport
    from vinefab.model.finding import Finding as Finding
    from vinefab.model.finding import Severity as Severity
    from vinefab.model.map import Map as Map
    from vinefab.model.map import Pose as Pose
    from vinefab.model.map import Start as Start
    from vinefab.model.outline import Contour as Contour
    from vinefab.model.score import Evaluation as Evaluation
    from vinefab.model.score import Score as Score
    from vinefab.prediction.aiming import AimResult as AimResult
    from vinefab.prediction.comparison import DesignComparison as DesignComparison
    from vinefab.prediction.map_info import MapInfo as MapInfo
    from vinefab.search.record.result import RunResult as RunResult
    from vinefab.search.run_pages import RunListing as RunListing
    from vinefab.search.settings import EvaluationSettings as EvaluationSettings
    from vinefab.search.settings import MapSettings as MapSettings
    from vinefab.search.settings import PartSettings as PartSettings
    from vinefab.search.settings import RunSettings as RunSettings
    from vinefab.search.settings import SearchSettings as SearchSettings
else:
    _HOME = {name: module for module, names in _HOMES.items() for name in names}

    def __getattr__(name: str) -> Any:  # noqa: ANN401  what the name stands for
        if name in ("maps", "rig"):
            return import_module(f"vinefab.{name}")
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_HOME[name]), name)
        return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
