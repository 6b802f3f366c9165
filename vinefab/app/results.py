"""What verbs return that no room has a result for: what was written, what was listed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vinefab.core.plain_text import counted
from vinefab.core.view import Block, Notes, Result, Rows, Text, lines

if TYPE_CHECKING:
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
    is_new
        Whether it was written now; False where it was there already and is left as it is.
    """

    path: Path
    summary: tuple[str, ...] = ()
    is_new: bool = True

    def __fspath__(self) -> str:
        """Return the path."""
        return str(self.path)

    def view(self) -> Iterator[Block]:
        """Yield the file and notes on it."""
        yield from [Text(f"written: {self.path}")] * self.is_new
        yield Notes(self.summary)

    def json_text(self) -> str:
        """Return what was written as JSON: ``vinefab/written-1``."""
        return _document("vinefab/written-1", {"files": [str(self.path)]})


class Names(tuple[str, ...]):
    """Names of shipped files and the user's own, with the lines that a shell prints.

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
