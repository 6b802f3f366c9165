"""What makes two runs the same run."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any, cast

from vinefab.core.errors import BadInputError
from vinefab.core.hashing import fingerprint
from vinefab.core.registry import Registry
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.map import Map
from vinefab.search.evaluator import Penalty
from vinefab.search.optimizers.shipped_optimizers import OPTIMIZERS
from vinefab.search.record.result import package_versions
from vinefab.search.settings import RunSettings, plain_settings
from vinefab.tasks.shipped_tasks import TASKS


@dataclass(frozen=True, slots=True, kw_only=True)
class RunIdentity:
    """Everything that decides a run's result, as plain values."""

    settings: Mapping[str, Any]  # the settings
    maps: tuple[str, ...]  # fingerprint of each map's content
    versions: Mapping[str, str]  # versions of vinefab and of what it computes with

    @classmethod
    def of(
        cls, settings: RunSettings, maps: Sequence[Map], penalty: Penalty | None = None
    ) -> "RunIdentity":
        """Return the identity of a run."""
        plain = cast("dict[str, Any]", plain_settings(settings))
        if is_dataclass(penalty):
            plain["making"] = plain_settings(penalty)
        return cls(
            settings=plain,
            maps=tuple(map_fingerprint(world) for world in maps),
            versions=package_versions(plugin_packages(settings)),
        )

    @property
    def run_id(self) -> str:
        """Name of the run: 12 hexadecimal digits; versions of other packages do not count."""
        return fingerprint(self._place_free_settings, self.maps, self.versions["vinefab"])

    @property
    def _place_free_settings(self) -> dict[str, Any]:
        """The settings without where map files lie: what is in them counts instead."""
        maps = {key: value for key, value in self.settings["maps"].items() if key != "files"}
        return {**self.settings, "maps": maps}

    def drift(self, recorded: "RunIdentity") -> list[str]:
        """Return which packages have another version than a record, as words for the user."""
        return [
            f"{name} {recorded.versions.get(name, 'none')} then, {number} now"
            for name, number in self.versions.items()
            if recorded.versions.get(name) != number
        ]

    def differs_from(self, recorded: "RunIdentity") -> BadInputError | None:
        """Return what keeps this run from going on with a record, or None."""
        if self.versions["vinefab"] != recorded.versions["vinefab"]:
            wanted = f"vinefab {recorded.versions['vinefab']}, which began the run"
            return BadInputError("--resume", f"vinefab {self.versions['vinefab']}", wanted)
        found = first_difference(self._place_free_settings, recorded._place_free_settings)
        if found is not None:
            key, mine, kept = found
            return BadInputError(key, mine, f"{kept!r}, with which the run began")
        if self.maps != recorded.maps:
            return BadInputError("maps", "other maps", "the maps with which the run began")
        return None


def plugin_packages(settings: RunSettings) -> list[str]:
    """Return the packages beside vinefab that a run's task, optimizer and environment are from."""
    environment = "" if settings.maps.files else settings.maps.environment
    named: tuple[tuple[Registry[Any], str], ...] = (
        (TASKS, settings.task.name),
        (OPTIMIZERS, settings.optimizer.name),
        (ENVIRONMENTS, environment),
    )
    # Whoever asks for a name makes the registry look for plug-ins.
    found = {parts.packages.get(name, "") for parts, name in named if name in parts}
    return sorted(found - {""})


def map_fingerprint(world: Map) -> str:
    """Return the name of a map's content: bounds, obstacles and starts."""
    starts = [asdict(start) for start in world.starts]
    return fingerprint(
        world.name,
        world.bounds.wkb_hex,
        [obstacle.wkb_hex for obstacle in world.obstacles],
        starts,
    )


def first_difference(
    one: object, other: object, path: str = ""
) -> tuple[str, object, object] | None:
    """Return where two plain values differ first and what each holds there, or None.

    Examples
    --------
    >>> first_difference({"a": {"b": 1, "c": 2}}, {"a": {"b": 1, "c": 3}})
    ('a.c', 2, 3)
    """
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in sorted({*one, *other}):
            inner = f"{path}.{key}" if path else str(key)
            if found := first_difference(one.get(key), other.get(key), inner):
                return found
        return None
    return None if one == other else (path, one, other)
