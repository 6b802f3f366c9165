"""What verbs return that no room has a result for: what was written, what was listed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted

if TYPE_CHECKING:
    from vinefab.model.design import Design
    from vinefab.model.finding import CheckReport
    from vinefab.prediction.deploy import DeployedDesign


def _shown(title: str, lines: tuple[str, ...]) -> str:
    from vinefab.noun_methods import html_table

    return html_table(title, ("",), [(line,) for line in lines])


def _document(schema: str, content: Mapping[str, object]) -> str:
    from vinefab.core.jsontext import json_text

    return json_text(schema, content)


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenFile:
    """A file to begin with that `new` wrote, or a page that `studio` wrote.

    Parameters
    ----------
    path
        The file; what is returned can be passed as a path.
    summary
        What a user should know, a line each.
    """

    path: Path
    summary: tuple[str, ...] = ()

    def __fspath__(self) -> str:
        """Return the path."""
        return str(self.path)

    def __repr__(self) -> str:
        return "\n".join([f"<WrittenFile {self.path}>", *self.summary])

    def _repr_html_(self) -> str:
        return _shown(f"written: {self.path}", self.summary)

    def json_text(self) -> str:
        """Return what was written as JSON: ``vinefab/written-1``."""
        return _document("vinefab/written-1", {"files": [str(self.path)]})


class Names(tuple[str, ...]):
    """Names of shipped files and the user's own, with what a shell prints of them.

    Examples
    --------
    >>> Names(["a", "b"])
    ('a', 'b')
    """

    lines: tuple[str, ...] = ()

    @classmethod
    def of(cls, names: Any, lines: Any = ()) -> Names:
        """Return names with lines about them; without lines the names alone."""
        found = cls(names)
        found.lines = tuple(lines)
        return found

    @property
    def summary(self) -> tuple[str, ...]:
        """A line for each."""
        return self.lines or tuple(self)

    def json_text(self) -> str:
        """Return the names as JSON: ``vinefab/names-1``."""
        return _document("vinefab/names-1", {"names": list(self)})


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenFolder:
    """A folder of files that `fabricate`, `rig` or `coupon` wrote.

    Parameters
    ----------
    path
        The folder.
    files
        Names of the files in it.
    report
        What the design rules say.
    summary
        What a user should know, a line each.
    """

    path: Path
    files: tuple[str, ...]
    report: CheckReport
    summary: tuple[str, ...] = ()

    def __fspath__(self) -> str:
        """Return the path: the folder can be passed where one is expected."""
        return str(self.path)

    def __repr__(self) -> str:
        return f"<WrittenFolder {self.path}: {counted(len(self.files), 'file')}>\n{self.report!r}"

    def _repr_html_(self) -> str:
        """Show the files and the findings in a notebook."""
        from vinefab.noun_methods import html_table

        files = html_table(f"written: {self.path}", ("file",), [(name,) for name in self.files])
        return files + self.report._repr_html_()

    def json_text(self) -> str:
        """Return the names of the files as JSON: ``vinefab/written-1``."""
        content = {"folder": str(self.path), "files": list(self.files)}
        return _document("vinefab/written-1", content)


@dataclass(frozen=True, slots=True, kw_only=True)
class WrittenReport:
    """A page that `report` wrote, or a recipe that `calibrate` wrote.

    Parameters
    ----------
    path
        The page (HTML) or the recipe (TOML).
    summary
        The verdict and the numbers to take away, a line each.
    numbers
        Every number as plain values, schema ``vinefab/prediction-1`` or ``vinefab/calibration-1``.
    """

    path: Path
    summary: tuple[str, ...]
    numbers: Mapping[str, Any]

    def __fspath__(self) -> str:
        """Return the path: a calibrated recipe is passed as ``recipe``."""
        return str(self.path)

    def __repr__(self) -> str:
        return "\n".join([f"<WrittenReport {self.path}>", *self.summary])

    def _repr_html_(self) -> str:
        return _shown(f"written: {self.path}", self.summary)

    def json_text(self) -> str:
        """Return the numbers as JSON."""
        return _numbers_text(self.numbers)


def _numbers_text(numbers: Mapping[str, Any]) -> str:
    rest = {name: value for name, value in numbers.items() if name not in ("schema", "generator")}
    return _document(numbers["schema"], rest)


@dataclass(frozen=True, slots=True, kw_only=True)
class ProposedFix:
    """What `fix` found.

    Parameters
    ----------
    design
        The changed design, or None where nothing had to or could be changed.
    report
        Its check; without a changed design that of the nearest one found, or of the design itself.
    summary
        What was changed, and what it costs, a line each.
    before
        The check of the design as it was.
    failed
        Whether errors are left that no change was found for.
    """

    design: Design | None
    report: CheckReport
    summary: tuple[str, ...]
    before: CheckReport | None = None
    failed: bool = False

    def __repr__(self) -> str:
        return "\n".join(["<ProposedFix>", *self.summary])

    def _repr_html_(self) -> str:
        """Show the changes and the changed design in a notebook."""
        from vinefab.noun_methods import svg_of

        return _shown("fix", self.summary) + ((self.design and svg_of(self.design)) or "")

    @property
    def exit_code(self) -> int:
        """The exit code of the command: 1 where errors are left."""
        return int(self.failed)

    def json_text(self) -> str:
        """Return the check of the design as it was, as JSON: ``vinefab/checks-1``."""
        return (self.before or self.report).json_text()


@dataclass(frozen=True, slots=True, kw_only=True)
class PhotoReport:
    """What `observe` read off a photo, or `fit_observations` off several.

    Parameters
    ----------
    path
        The page (HTML), the observation (JSON) or the fitted numbers (TOML); None if none was
        asked for.
    summary
        The numbers to take away, a line each.
    numbers
        Every number as plain values, schema ``vinefab/observation-1`` or ``vinefab/contacts-1``.
    """

    path: Path | None
    summary: tuple[str, ...]
    numbers: Mapping[str, Any]

    def __fspath__(self) -> str:
        """Return the path: fitted numbers are passed as ``contacts``, observations to the fit."""
        if self.path is None:
            raise BadInputError("path", None, "a file: observe or fit with out=")
        return str(self.path)

    def __repr__(self) -> str:
        return "\n".join(["<PhotoReport>", *self.summary])

    def _repr_html_(self) -> str:
        title = "not written" if self.path is None else f"written: {self.path}"
        return _shown(title, self.summary)

    def json_text(self) -> str:
        """Return the numbers as JSON."""
        return _numbers_text(self.numbers)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GrownDesign:
    """What `grow` found: a deployment, with its shapes on the way if they were asked for.

    Parameters
    ----------
    deployed
        The deployment with its design, map and growth options.
    fronts
        At which lengths of the growing front, mm, or in how many equal steps its shape is told.
    """

    deployed: DeployedDesign
    fronts: int | tuple[float, ...] | None = None

    def __repr__(self) -> str:
        return "\n".join(["<GrownDesign>", *self.summary])

    @property
    def summary(self) -> tuple[str, ...]:
        """What became of the branches and why, a line each."""
        return tuple(self.deployed.summary())

    def json_text(self) -> str:
        """Return every branch with its points as JSON: ``vinefab/deployment-1``."""
        from vinefab.prediction.deploy import frames_of

        shapes = None if self.fronts is None else frames_of(self.deployed.history, self.fronts)
        return self.deployed.text(shapes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StudyOutcome:
    """What a study or the demonstration found.

    Parameters
    ----------
    found
        The result of the room that did the work.
    summary
        The numbers to take away, a line each.
    text
        The JSON document.
    exit_code
        Of the command.
    """

    found: Any
    summary: tuple[str, ...]
    text: Callable[[], str] = field(repr=False)
    exit_code: int = 0

    def __repr__(self) -> str:
        return "\n".join([f"<StudyOutcome of {type(self.found).__name__}>", *self.summary])

    def json_text(self) -> str:
        """Return everything as JSON."""
        return self.text()
