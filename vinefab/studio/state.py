"""What is open on the page: design, map with edits, start, recipe, task, family of maps."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from annotated_types import Interval, MinLen
from pydantic import Field
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.table import Table, validated
from vinefab.growth.options import GrowthChoice, GrowthOptions
from vinefab.model.design import Design, design_of
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map, Pose
from vinefab.prediction.deploy import as_grown
from vinefab.studio.edited_map import PAGE, Ground, file_stamp, ground_of, world_of

MOST_FAMILY, MOST_POSES = 200, 5


class Family(Table):
    """The maps of the panel with many maps: seeds of an environment, or files."""

    environment: Annotated[str, MinLen(1)] = "grid"
    count: Annotated[int, Interval(ge=1, le=MOST_FAMILY)] = 40
    seed: Annotated[int, Interval(ge=0, le=2**31), Doc("of the first map; the others follow")] = (
        1000
    )
    poses: Annotated[
        int, Interval(ge=1, le=MOST_POSES), Doc("on each map, drawn from its starts")
    ] = 1
    files: Annotated[
        tuple[str, ...],
        Field(strict=False, max_length=MOST_FAMILY),
        Doc("in place of an environment"),
    ] = ()
    stamp: Annotated[str, Doc("changes when a file has changed")] = ""

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "Family":
        """Return the family that the page asks for."""
        given = {key: value for key, value in content.items() if key != "files" or value}
        try:
            return validated(cls, given, PAGE)
        except BadInputError as error:
            raise BadInputError(f"family.{error.key}", error.value, error.allowed, PAGE) from error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StudioState:
    """What is open on the page, read and validated.

    The page sends it whole with every question, so that the server remembers nothing of a tab.
    """

    design: Design
    world: Map | None  # with the page's edits and targets; None where no map is open
    ground: Ground | None  # the same without the page's targets
    pose: Pose | None  # None: the map's first start
    profile: LaserProfile
    recipe: str  # what the profile was opened by
    task: str
    family: Family
    growth: GrowthOptions
    locks: frozenset[str]  # dotted keys of the design that must not change: ``level.0.angle_deg``

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "StudioState":
        """Return the state that the page sent.

        Raises
        ------
        VinefabError
            If a value or a file cannot be used.
        """
        given = _mapping("state", content)
        design = design_of(_mapping("design", given.get("design")), PAGE)
        recipe = _text("recipe", given.get("recipe") or DEFAULT_RECIPE)
        shown = None if given.get("map") is None else _mapping("map", given["map"])
        return cls(
            design=design,
            world=None if shown is None else world_of(shown),
            ground=None if shown is None else ground_of(shown),
            pose=_pose(given.get("pose")),
            profile=current_profile(recipe),
            recipe=recipe,
            task=_text("task", given.get("task") or "coverage"),
            family=Family.of(_mapping("family", given.get("family") or {})),
            growth=GrowthChoice.of([design], _mapping("growth", given.get("growth") or {})).options,
            locks=frozenset(_texts("locks", given.get("locks") or [])),
        )

    @property
    def grown(self) -> Design:
        """The design as it deploys."""
        return as_grown(self.design, self.profile)

    @property
    def grown_now(self) -> Design:
        """The design as it deploys, by what is known without simulating joints."""
        return as_grown(self.design, self.profile, known_only=True)

    @property
    def start(self) -> Pose | None:
        """Where the robot starts: the page's pose, or the map's first start."""
        if self.pose is not None or self.world is None or not self.world.starts:
            return self.pose
        return self.world.starts[0].pose


def is_name(given: object) -> bool:
    """Tell whether this is a bare name, as of a shipped design, and no path."""
    return isinstance(given, str) and not Path(given).suffix and Path(given).parent == Path()


def files_named_in(content: Mapping[str, Any]) -> list[tuple[str, object]]:
    """Return the files that a state names, each with its key: `StudioState.of` reads no others."""
    source = _member(_member(content, "map"), "source")
    files = _member(content, "family").get("files")
    named = [("map.source.file", source.get("file")), ("recipe", content.get("recipe") or None)]
    named += [("family.files", name) for name in files] if isinstance(files, list) else []
    return [(key, given) for key, given in named if given is not None]


def _member(content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = content.get(key)
    return value if isinstance(value, Mapping) else {}


def current_profile(recipe: str) -> LaserProfile:
    """Return the laser profile of a recipe, read anew when its file has changed."""
    path = locate("recipe", recipe)
    return _profile(recipe, file_stamp(path))


@lru_cache(maxsize=16)
def _profile(recipe: str, stamp: str) -> LaserProfile:  # noqa: ARG001  see profile_of
    return read_profile(recipe)


def _pose(content: Any) -> Pose | None:  # noqa: ANN401  JSON
    if content is None:
        return None
    given = _mapping("pose", content)
    try:
        return Pose.of((given["x_mm"], given["y_mm"], given["heading_deg"]))
    except KeyError as error:
        raise BadInputError("pose", dict(given), "x_mm, y_mm and heading_deg", PAGE) from error


def _text(key: str, value: object) -> str:
    if not isinstance(value, str) or not value:
        raise BadInputError(key, value, "a text", PAGE)
    return value


def _texts(key: str, value: object) -> list[str]:
    if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
        raise BadInputError(key, value, "a list of texts", PAGE)
    return value


def _mapping(key: str, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise BadInputError(key, value, "names with values", PAGE)
    return value
