"""What verbs return that no room has a result for: what was written, what was listed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.view import Block, Notes, Picture, Result, Rows, Text, lines

if TYPE_CHECKING:
    from vinefab.model.design import Design
    from vinefab.model.finding import CheckReport


def _document(schema: str, content: Mapping[str, object]) -> str:
    from vinefab.core.jsontext import json_text

    return json_text(schema, content)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class WrittenFile(Result):
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

    def view(self) -> Iterator[Block]:
        """Yield the file and what to know about it."""
        yield from (Text(f"written: {self.path}"), Notes(self.summary))

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


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class WrittenFolder(Result):
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

    def view(self) -> Iterator[Block]:
        """Yield the files and the findings."""
        yield Text(f"written: {self.path}: {counted(len(self.files), 'file')}")
        files = tuple((name,) for name in self.files)
        yield Rows(caption="files", headings=("file",), rows=files)
        yield from self.report.view()

    def __repr__(self) -> str:
        return "\n".join([f"<WrittenFolder {self.path}>", *lines(self.view())])

    def json_text(self) -> str:
        """Return the names of the files as JSON: ``vinefab/written-1``."""
        content = {"folder": str(self.path), "files": list(self.files)}
        return _document("vinefab/written-1", content)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class WrittenReport(Result):
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

    def view(self) -> Iterator[Block]:
        """Yield the file and the numbers to take away."""
        yield from (Text(f"written: {self.path}"), Notes(self.summary))

    def json_text(self) -> str:
        """Return the numbers as JSON."""
        return _numbers_text(self.numbers)


def _numbers_text(numbers: Mapping[str, Any]) -> str:
    rest = {name: value for name, value in numbers.items() if name not in ("schema", "generator")}
    return _document(numbers["schema"], rest)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ProposedFix(Result):
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

    def view(self) -> Iterator[Block]:
        """Yield the changes and the changed design."""
        drawn = self.design and self.design._repr_svg_()
        if drawn:
            yield Picture(image=drawn.encode(), caption="The changed design, flat (computed).")
        yield Notes(self.summary)

    @property
    def exit_code(self) -> int:
        """The exit code of the command: 1 where errors are left."""
        return int(self.failed)

    def json_text(self) -> str:
        """Return the check of the design as it was, as JSON: ``vinefab/checks-1``."""
        return (self.before or self.report).json_text()


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class PhotoReport(Result):
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

    def view(self) -> Iterator[Block]:
        """Yield the file, if one was written, and the numbers to take away."""
        yield Text("not written" if self.path is None else f"written: {self.path}")
        yield Notes(self.summary)

    def json_text(self) -> str:
        """Return the numbers as JSON."""
        return _numbers_text(self.numbers)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StudyOutcome(Result):
    """What a study or the demonstration found.

    Parameters
    ----------
    found
        The result of the room that did the work.
    blocks
        The numbers to take away.
    text
        The JSON document.
    exit_code
        Of the command.
    """

    found: Any
    blocks: tuple[Block, ...]
    text: Callable[[], str] = field(repr=False)
    exit_code: int = 0

    def view(self) -> tuple[Block, ...]:
        """Return the numbers to take away."""
        return self.blocks

    def json_text(self) -> str:
        """Return everything as JSON."""
        return self.text()
