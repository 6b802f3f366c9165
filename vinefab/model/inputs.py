"""What callers give, and how it becomes a noun: an object, a path or a name; in a shell a text.

To type checkers each ``...Like`` is the union that Python takes, at run time the `Kind` by which a
shell types it.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from vinefab.core.errors import BadInputError, UnfitInputError, nearest
from vinefab.core.front_door import imported_later
from vinefab.core.verbs import Also, Doc, Kind, also, note, numbers_from, text_of

if TYPE_CHECKING:
    from typing import TypedDict, Unpack

    from vinefab.model import contacts, design, laser, target
    from vinefab.model import map as maps
    from vinefab.model import start as start_words
    from vinefab.model.design import Design
    from vinefab.model.files import shipped
    from vinefab.model.laser import LaserProfile
    from vinefab.model.map import Map, Pose
    from vinefab.model.start import StartLike
    from vinefab.model.target import Target
else:
    contacts, design, laser, maps, start_words, target, shipped = (
        imported_later(f"vinefab.model.{name}")
        for name in ("contacts", "design", "laser", "map", "start", "target", "files.shipped")
    )


def all_names(kind: str) -> tuple[str, ...]:
    """Return the names of the shipped files of a kind and of the user's own."""
    return tuple(sorted({*shipped.names(kind), *shipped.user_names(kind)}))


# --- Texts of a shell ---------------------------------------------------------------------------


def _plain(text: str) -> object:
    """Return a number, a truth value, a list (JSON) or, of anything else, the text."""
    if text in ("true", "false"):
        return text == "true"
    if text.startswith("["):
        try:
            listed: object = json.loads(text)
        except (ValueError, RecursionError):
            return text
        return listed
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def _named(text: str, allowed: str = "NAME=VALUE") -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not name or not equals:
        raise BadInputError("", text, allowed)
    return name, value


def _pair(text: str) -> tuple[str, object]:
    name, value = _named(text)
    return name, _plain(value)


def _growth_pair(text: str) -> tuple[str, object]:
    name, value = _named(text, "NAME=VALUE, such as pressure_stop=false")
    parts = [_plain(part) for part in value.split(",")]
    return name, parts if len(parts) > 1 else parts[0]


def _once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    found = dict[str, object]()
    for name, value in pairs:
        if name in found:
            raise UnfitInputError("", f"{name} is given twice", "leave one of them out")
        found[name] = value
    return found


def _pair_words(pairs: Mapping[str, object]) -> list[str]:
    shown = {
        name: json.dumps(value) if isinstance(value, list | tuple) else text_of(value)
        for name, value in pairs.items()
    }
    return [f"{name}={text}" for name, text in shown.items()]


def _growth_words(pairs: Mapping[str, object]) -> list[str]:
    found = list[str]()
    for name, value in pairs.items():
        parts = value if isinstance(value, list | tuple) else [value]
        shown = (str(one).lower() if isinstance(one, bool) else str(one) for one in parts)
        found.append(f"{name}={','.join(shown)}")
    return found


def _limit(text: str) -> tuple[str, str, float]:
    key, equals, value = text.partition("=")
    rule, dot, name = key.strip().partition(".")
    try:
        number = float(value)
    except ValueError:
        equals = ""
    if not (rule and dot and name and equals):
        raise BadInputError("", text, "RULE.NAME=NUMBER, as VF-C01.warning=6")
    return rule, name, number


def _by_rule(limits: list[tuple[str, str, float]]) -> dict[str, dict[str, float]]:
    values = dict[str, dict[str, float]]()
    for rule, name, number in limits:
        values.setdefault(rule, {})[name] = number
    return values


def _limit_words(limits: Mapping[str, Mapping[str, float]]) -> list[str]:
    return [f"{rule}.{name}={text_of(value)}"
            for rule, values in limits.items() for name, value in values.items()]  # fmt: skip


def _pose(text: str) -> tuple[float, ...]:
    try:
        return numbers_from(text, 3)
    except BadInputError:
        raise BadInputError("", text, "X,Y,DEG: three numbers, mm and degrees") from None


def _pose_words(pose: Any) -> list[str]:  # noqa: ANN401  a pose or three numbers
    of_pose = hasattr(pose, "heading_deg")
    numbers = (pose.x_mm, pose.y_mm, pose.heading_deg) if of_pose else pose
    return [",".join(map(text_of, numbers))]


def _half_angle(text: str) -> float | tuple[float, ...]:
    numbers = numbers_from(text)
    if len(numbers) > 2:
        raise BadInputError("", text, "a number, or a range LOW,HIGH")
    return numbers[0] if len(numbers) == 1 else numbers


def _numbers_words(value: Any) -> list[str]:  # noqa: ANN401  a number or several
    alone = isinstance(value, str) or not isinstance(value, Iterable)
    return [",".join(map(text_of, [value] if alone else value))]


def several_numbers(metavar: str) -> Kind:
    """Return the kind of several numbers: ``50,84,176``."""
    return Kind(metavar=metavar, read=numbers_from, words=_numbers_words, hyphen=True)


def _points(text: str) -> tuple[tuple[float, ...], ...]:
    try:
        return tuple(numbers_from(part, 2) for part in text.split(";"))
    except BadInputError:
        raise BadInputError("", text, "points X,Y with semicolons between them") from None


POINTS = Kind(
    metavar="X,Y;X,Y",
    read=_points,
    words=lambda points: [";".join(",".join(map(text_of, point)) for point in points)],
    hyphen=True,
)


def _target_words(given: Any) -> list[str]:  # noqa: ANN401  judged one by one
    words = []
    for one in as_targets(given):
        if isinstance(one, str):
            words.append(one)
        else:
            (found,) = target.targets_given([one], "targets")
            named = found if isinstance(one, target.Target | Mapping) else found.changed(name="")
            words.append(target.target_text(named))
    return words


def written(*endings: str) -> Kind:
    """Return the kind of a file to write, with one of some endings."""
    return Kind(metavar="FILE", writes="file", ends=endings)


PICTURE_ENDS = (".svg", ".png", ".pdf")
"""Endings of the files that figures are written to."""

Body = Literal["inflated", "centerline"]
ChildrenOfStuck = Literal["stop", "deploy"]

MAP_SUFFIXES = (".geojson", ".json")
FOLDER = Kind(metavar="DIR", writes="folder")
DESIGN_KIND = Kind(metavar="DESIGN", files=partial(all_names, "design"))
DESIGNS = Kind(metavar="DESIGN", files=partial(all_names, "design"), several=True)
MAP = Kind(metavar="MAP")
PAIRS = Kind(metavar="NAME=VALUE", read=_pair, gather=_once, words=_pair_words, several=True)

if TYPE_CHECKING:
    PathText = str | PathLike[str]
    DesignLike = Design | str | PathLike[str]
    DesignsLike = DesignLike | Iterable[DesignLike]
    MapLike = Map | str | PathLike[str]
    MapsLike = MapLike | Iterable[MapLike]
    StartsLike = StartLike | Iterable[StartLike]
    TargetLike = Target | tuple[float, float] | Mapping[str, object] | str
    TargetsLike = TargetLike | Iterable[TargetLike]
    PoseLike = Pose | tuple[float, float, float]
    RecipeLike = LaserProfile | str | PathLike[str]
    ContactsLike = Mapping[str, object] | str | PathLike[str]
    HalfAngle = float | tuple[float, float]
    BodyWidth = Body
    StuckChildren = ChildrenOfStuck
    Pairs = Mapping[str, object]
    GrowthLike = Pairs

    class GrowthShortcuts(TypedDict, total=False):
        """Growth options that verbs and `Design.grow` take by name; None: not given."""

        body: Body | None
        head_on_half_angle_deg: HalfAngle | None
        contacts: ContactsLike | None
        children_of_stuck: ChildrenOfStuck | None

    LimitsLike = Mapping[str, Mapping[str, float]]
    WordsLike = str | Iterable[str]
else:
    PathText = Annotated[object, Kind(metavar="FILE")]
    DesignLike = Annotated[object, DESIGN_KIND, Doc("A design, its path or its name.")]
    DesignsLike = Annotated[object, DESIGNS]
    MapLike = Annotated[object, MAP, Doc("A map, or the path of a map file.")]
    MapsLike = Annotated[
        object,
        Kind(metavar="MAP", several=True),
        Doc("Maps or paths of map files: --maps *.geojson."),
        also("--map"),
    ]
    StartLike = Annotated[object, Kind(metavar="START", hyphen=True)]
    StartsLike = Annotated[
        object,
        Kind(metavar="START", several=True, hyphen=True),
        Doc("Where robots start, in place of the map's starts: X,Y,DEG+-SPREAD, 'left side', "
            "'line X,Y X,Y' or 'area X,Y X,Y', then heading DEG+-SPREAD (docs/maps.md)."),
    ]  # fmt: skip
    TargetsLike = Annotated[
        object,
        Kind(metavar="TARGET", several=True, hyphen=True, words=_target_words),
        also("--target"),
        Doc("What robots are to touch, in place of the map's targets: [NAME=]X,Y[+-TOLERANCE] "
            "in mm."),
    ]  # fmt: skip
    PoseLike = Annotated[
        object,
        Kind(metavar="X,Y,DEG", read=_pose, words=_pose_words, hyphen=True),
        Doc("Where the robot starts, X,Y,DEG in mm and degrees; default: the map's first start."),
    ]
    RecipeLike = Annotated[
        object,
        Kind(metavar="RECIPE", files=partial(all_names, "recipe")),
        Doc("A recipe's name or path, in Python also a laser profile; default: that of the run "
            "that found the design, else the shipped one."),
    ]  # fmt: skip
    ContactsLike = Annotated[
        object,
        Kind(metavar="FILE"),
        Doc(
            "Numbers that photos or a contact coupon measured (`fit_observations`), in place of "
            "assumed ones."
        ),
    ]
    HalfAngle = Annotated[
        object,
        Kind(metavar="DEG", read=_half_angle, words=_numbers_words, hyphen=True),
        Doc("Contacts closer to head-on than this stop a tip (assumed; smooth walls 1 to 15, rough "
            "ones 15 to 45); a range LOW,HIGH gives every deployment another value."),
    ]  # fmt: skip
    Pairs = Annotated[object, PAIRS]
    GrowthLike = Annotated[
        object,
        Kind(metavar="NAME=VALUE", read=_growth_pair, gather=_once, words=_growth_words,
             several=True),
        Doc("Growth options by name, in place of the design's or the defaults: "
            "pressure_stop=false, head_on_half_angle_deg=1,15 (a range)."),
    ]  # fmt: skip
    BodyWidth = Annotated[Body, Doc("How wide a body is; default: as the design was trained.")]
    StuckChildren = Annotated[
        ChildrenOfStuck,
        Doc("Children of a branch that stopped early: they never emerge, or grow from there."),
    ]
    LimitsLike = Annotated[
        object,
        Kind(metavar="RULE.LEVEL=VALUE", read=_limit, gather=_by_rule, words=_limit_words,
             several=True),
        Also(("--limit",)),
        Doc("Limits in place of the rules' own: VF-C01.warning=6, in Python "
            '``{"VF-C01": {"warning": 6.0}}``.'),
    ]  # fmt: skip
    WordsLike = Annotated[object, Kind(metavar="WORD,...", several=True)]


# --- Nouns --------------------------------------------------------------------------------------


def as_path(key: str, given: object, allowed: str = "a path") -> Path:
    """Return a path that a caller passed, or raise BadInputError if it is something else."""
    return shipped.path_given(key, given, allowed)


def name_or_path(key: str, given: object, allowed: str, kind: str = "") -> str | Path:
    """Return a name or a path, or raise BadInputError for anything else.

    Parameters
    ----------
    kind
        Of the file: where a registered name of it is a file here too, the caller is told so.
    """
    if not isinstance(given, str):
        return as_path(key, given, allowed)
    here = Path(f"{given}.toml")
    if kind and given in all_names(kind) and here.is_file() and not Path(given).is_file():
        note(f"{given} is the {kind} that ships or that your own folder has; type {here} for the "
             "file here")  # fmt: skip
    return given


def as_design(given: "DesignLike", key: str = "design") -> "Design":
    """Return a design, passed as such, by its path or by its name."""
    if isinstance(given, design.Design):
        return given
    allowed = f"a Design, a path, or one of {', '.join(all_names('design'))}"
    return design.Design.read(name_or_path(key, given, allowed, "design"))


def as_designs(given: "DesignsLike", key: str) -> "list[Design]":
    """Return one or several designs."""
    return [as_design(one, key) for one in as_several(given)]


def as_recipe(given: "RecipeLike") -> "LaserProfile":
    """Return a laser profile, passed as such, or by its recipe's path or name."""
    if isinstance(given, laser.LaserProfile):
        return given
    allowed = f"a LaserProfile, a path, or one of {', '.join(all_names('recipe'))}"
    return laser.read_profile(name_or_path("recipe", given, allowed, "recipe"))


def as_map(
    given: "MapLike", key: str = "map", start: "StartsLike" = (), targets: "TargetsLike" = ()
) -> "Map":
    """Return a map, passed as such or by its path; with other starts and targets, if given."""
    if isinstance(given, maps.Map):
        world = given
    else:
        path = as_path(key, given, "a Map, or the path of a map file (GeoJSON)")
        named = (path.parent / f"{path.name}{suffix}" for suffix in ("", *MAP_SUFFIXES))
        path = next((one for one in named if one.is_file()), path)
        if path.suffix == "" and path.parent == Path() and not path.exists():
            near = nearest(f"{path}{MAP_SUFFIXES[0]}", [one.name for one in Path().glob("*json")])
            hint = near.removeprefix("; ") or "give a map file (GeoJSON)"
            remedy = f"{hint}, or in Python a Map such as vf.maps.grid(seed=1)"
            raise UnfitInputError(key, f"there is no map file {str(given)!r}", remedy)
        world = maps.Map.read(shipped.existing_file(path, near=path.suffix))
    aims = as_targets(targets)
    world = world.with_targets(*aims) if aims else world
    starts = [start_words.start_given(one) for one in as_starts(start)]
    return start_words.with_starts(world, starts) if starts else world


def as_targets(given: Any) -> Sequence[Any]:  # noqa: ANN401  judged one by one
    """Return one target or several as a sequence: two numbers are one point."""
    return _places(given, 2)


def as_starts(given: Any) -> Sequence[Any]:  # noqa: ANN401  judged one by one
    """Return one start or several as a sequence: three numbers are one pose."""
    return _places(given, 3)


def _places(given: Any, numbers: int) -> Sequence[Any]:  # noqa: ANN401  judged one by one
    """Return one place or several as a sequence; so many numbers, or a table, are one."""
    if given is None:
        return ()
    found = (given,) if isinstance(given, Mapping) or _is_one(given) else tuple(given)
    is_place = len(found) == numbers and all(isinstance(one, int | float) for one in found)
    return (found,) if is_place else found


def as_maps(
    given: "MapsLike", start: "StartsLike" = (), targets: "TargetsLike" = ()
) -> "list[Map]":
    """Return one or several maps, each as in `as_map`."""
    return [as_map(one, "maps", start, targets) for one in as_several(given)]


def as_several(given: Any) -> Sequence[Any]:  # noqa: ANN401  judged one by one
    """Return one thing, or an iterable of them, as a sequence."""
    if isinstance(given, Mapping):
        given = given.values()
    return (given,) if _is_one(given) else tuple(given)


def _is_one(given: object) -> bool:
    """Tell whether this is a single thing; tables and results are, although they iterate."""
    is_whole = any(hasattr(type(given), name) for name in ("model_fields", "records"))
    return is_whole or isinstance(given, str | PathLike) or not isinstance(given, Iterable)


def as_mapping(key: str, given: object) -> Mapping[str, Any]:
    """Return names with values; none for None."""
    if given is not None and not isinstance(given, Mapping):
        raise BadInputError(key, given, "names with their values, a dict")
    return given or {}


def as_limits(given: object) -> dict[str, Mapping[str, Any]]:
    """Return limits of rules by rule and name."""
    named = as_mapping("limits", given)
    return {str(rule): as_mapping(f"limits.{rule}", values) for rule, values in named.items()}


def as_growth(given: object, **shortcuts: "Unpack[GrowthShortcuts]") -> Mapping[str, Any]:
    """Return growth options by name: those of a mapping, and those with a parameter of their own.

    Every verb and `Design.grow` hand on what they were given; `GrowthOptions.of` judges it.
    """
    options = dict(as_mapping("growth", given))
    for name, value in shortcuts.items():
        if value is None:
            continue
        if name in options and options[name] != value:
            problem = f"{value!r} is given together with {options[name]!r} in growth"
            raise UnfitInputError(name, problem, "leave one of them out")
        options[name] = value
    if isinstance(options.get("contacts"), str | PathLike):
        options["contacts"] = contacts.read_contacts(options["contacts"])
    return options


def as_tuple(key: str, given: object, allowed: str) -> tuple[Any, ...]:
    """Return several values, or raise BadInputError for a single one."""
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise BadInputError(key, given, allowed)
    return tuple(given)
