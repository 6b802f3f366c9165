"""Every verb: the words of its command, where its function stands, and its line in the help."""

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple


class Verb(NamedTuple):
    """Where a verb is found, and its line in the list of commands."""

    where: str  # ``module:function``
    summary: str
    listed: bool = True  # whether ``vinefab --help`` shows it

    @property
    def function(self) -> Callable[..., Any]:
        """The function, whose module is imported for it."""
        found: Callable[..., Any] = loaded(self.where)
        return found


def loaded(where: str) -> Any:
    """Return a part of a module: ``module:name``."""
    module, _, name = where.partition(":")
    return getattr(import_module(module), name)


_APP = "vinefab.app"
_MAPS = "vinefab.app.maps"

VERBS = {
    "new": Verb(
        f"{_APP}.files:new", "Write a file to begin with: a design, run, map, recipe, machine."
    ),
    "examples": Verb(
        f"{_APP}.files:examples", "List the examples that ship with vinefab, or copy them."
    ),
    "designs": Verb(
        f"{_APP}.files:designs", "List the designs that ship, and your own.", listed=False
    ),
    "studio": Verb(
        f"{_APP}.searching:studio",
        "Design in the browser: growth, score, rules and sheet follow every change.",
    ),
    "demo": Verb(
        f"{_APP}.searching:demo",
        "Run the main job at small size: maps, optimization, package, rig, report.",
    ),
    "map import": Verb(f"{_MAPS}:import_", "Import a map from another program, or from a photo."),
    "map start": Verb(f"{_MAPS}:start", "Give a map other starts."),
    "map info": Verb(f"{_MAPS}:info", "Describe a map."),
    "grow": Verb(f"{_APP}.predicting:grow", "Deploy a design on a map."),
    "score": Verb(f"{_APP}.predicting:score", "Score a design on a task over maps and poses."),
    "aim": Verb(f"{_APP}.predicting:aim", "Search a map for the best place of a robot's base."),
    "optimize": Verb(f"{_APP}.searching:optimize", "Search for the best design of a run file."),
    "runs": Verb(f"{_APP}.searching:runs", "List the records of runs, or rebuild their files."),
    "compare": Verb(
        f"{_APP}.predicting:compare",
        "Compare designs on the same maps and poses, with paired statistics.",
    ),
    "check": Verb(
        f"{_APP}.making:check", "Check a design against the rules of making and deploying it."
    ),
    "fix": Verb(f"{_APP}.making:fix", "Propose the smallest change that clears a design's errors."),
    "rules": Verb(f"{_APP}.files:rules", "List the design rules, or explain one."),
    "inflate": Verb(
        f"{_APP}.making:inflate",
        "Show the shape that a design's flat pattern takes under pressure.",
    ),
    "fabricate": Verb(
        f"{_APP}.making:fabricate", "Write the fabrication package: laser files, checks, report."
    ),
    "coupon": Verb(
        f"{_APP}.making:coupon",
        "Write test pieces for a recipe: files, instructions, a table to fill in.",
    ),
    "calibrate": Verb(f"{_APP}.making:calibrate", "Fit a recipe to coupon results, and write it."),
    "profiles": Verb(
        f"{_APP}.files:profiles", "List machines, materials and recipes, or explain one."
    ),
    "recipes": Verb(
        f"{_APP}.files:recipes", "List the recipes that ship, and your own.", listed=False
    ),
    "printers": Verb(
        f"{_APP}.files:printers", "List the 3-D printers that ship, and your own.", listed=False
    ),
    "rig": Verb(f"{_APP}.making:rig", "Write printable obstacles for a test rig."),
    "observe": Verb(
        f"{_APP}.predicting:observe",
        "Trace a grown robot on a photo and compare it with the prediction.",
    ),
    "fit-observations": Verb(
        f"{_APP}.predicting:fit_observations",
        "Fit what several photos of grown robots measured together.",
    ),
    "report": Verb(f"{_APP}.predicting:report", "Write predictions for a design as one HTML page."),
    "study contest": Verb(
        f"{_APP}.searching:contest", "Compare optimizers on run files, with statistics."
    ),
    "study reproduce": Verb(
        f"{_APP}.searching:reproduce", "Do the paper's experiments again, with statistics."
    ),
    "study benchmark": Verb(
        f"{_APP}.searching:benchmark", "Score a way to design on frozen problems; compare ranks it."
    ),
    "study bench": Verb(
        f"{_APP}.searching:bench", "Measure the speed of the growth simulator on this computer."
    ),
}
"""Every verb, in the order of ``--help``."""

GROUPS = {
    "map": "Generate or import a map.",
    "study": "Compare optimizers, do the paper's experiments again, measure speed.",
}
"""Words that stand before several commands."""

HELP = ("-h", "--help")

PER_NAME = {"map": (f"{_MAPS}:generate", "vinefab.maps.generators.environments:ENVIRONMENTS")}
"""Groups with a command for every name of a registry: the function, whose first parameter is the
name, and the registry; its parts have ``description`` and ``options``."""

SHORT = {"reproduce": "study reproduce", "bench": "study bench"}
"""Commands that may be typed without their group."""
