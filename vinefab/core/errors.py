"""The errors that vinefab raises on purpose.

Each is also a matching built-in, carries its facts as fields and prints as one line. They are
caught in one place, the command line, which turns them into that line and exit code 2. A stuck
growth is a result and a broken design rule is a finding; neither is an error.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from reprlib import Repr

from vinefab.core.plain_text import quoted, readable


class VinefabError(Exception):
    """Root of every error that vinefab raises on purpose."""


class BadInputError(VinefabError, ValueError):
    """A value given by a user is out of range: the line says which values are allowed.

    Parameters
    ----------
    source
        The file that holds the value, or None when it came from the command line or a caller.
    """

    def __init__(
        self, key: str, value: object, allowed: str, source: str | Path | None = None
    ) -> None:
        self.key = key
        self.value = value
        self.allowed = allowed
        self.source = None if source is None else str(source)
        super().__init__(key, value, allowed, source)

    def __str__(self) -> str:
        where = f"{self.source}: " if self.source else ""
        value = " ".join(_BEGINNING.repr(self.value).split())
        value = value if len(value) <= 60 else f"{value[:57]}..."
        given = "is missing; give" if self.value is None else f"is {value}; allowed:"
        return f"{where}{shortened(self.key)} {given} {self.allowed}"

    def at(self, source: str | Path) -> "BadInputError":
        """Return the same error with the file that holds the value."""
        return self.under(self.key, source)

    def under(self, key: str, source: str | Path | None = None) -> "BadInputError":
        """Return the same error under another key, in a file or in none."""
        return type(self)(key, self.value, self.allowed, source)


class UnfitInputError(BadInputError):
    """Input does not fit for a reason that no range tells: a place, a sentence and a remedy.

    Parameters
    ----------
    key
        The place: a key, an option, a line. Empty where the sentence names it.
    problem
        The sentence, without a full stop. One that begins with its verb (``is missing``) has the
        key as its subject.
    remedy
        What to do, as an imperative.
    """

    def __init__(
        self, key: str, problem: str, remedy: str, source: str | Path | None = None
    ) -> None:
        super().__init__(key, problem, remedy, source)

    def __str__(self) -> str:
        sentence = shortened(" ".join(str(self.value).split()), 400)
        key = shortened(self.key)
        if key:
            has_subject = sentence.partition(" ")[0] not in _VERBS
            sentence = f"{key}: {sentence}" if has_subject else f"{key} {sentence}"
        return f"{f'{self.source}: ' if self.source else ''}{sentence}; {self.allowed}"


_VERBS = {"is", "are", "has", "have", "means", "needs", "hold", "holds", "belongs", "goes", "fixes"}
_VERBS |= {"stands", "lies", "leads", "changes"}


class _FileError(VinefabError):
    """A file has a problem."""

    def __init__(self, path: str | Path, problem: str) -> None:
        self.path = str(path)
        self.problem = problem
        super().__init__(path, problem)


class UnreadableFileError(_FileError, OSError):
    """A file is missing, not readable, or not of the kind it should be."""

    def __str__(self) -> str:
        return f"{self.path}: {shortened(self.problem, _MOST_LETTERS)}"


class UnknownNameError(VinefabError, KeyError):
    """A name is not among the known ones; the nearest spelling is offered."""

    def __init__(
        self,
        kind: str,
        name: str,
        known: Iterable[str],
        source: str | Path | None = None,
        problem: str = "",
    ) -> None:
        self.kind = kind
        self.name = name
        self.known = tuple(sorted(known))
        self.source = None if source is None else str(source)
        self.problem = problem
        super().__init__(kind, name, self.known, source, problem)

    def __str__(self) -> str:
        where = f"{self.source}: " if self.source else ""
        there = f"there are: {', '.join(self.known)}" if self.known else "there are none"
        name = shortened(quoted(self.name))
        if self.problem:
            return f"{where}{self.kind} {name} does not load ({self.problem}); {there}"
        hint = nearest(self.name, self.known)
        return f"{where}no {self.kind} is called {name}{hint}; {there}"

    def at(self, source: str | Path) -> "UnknownNameError":
        """Return the same error with the file that holds the name."""
        return type(self)(self.kind, self.name, self.known, source, self.problem)


class BrokenPluginError(VinefabError, ImportError):
    """A plug-in, code of another package, breaks down while it is loaded or called."""

    def __init__(self, plugin: str, problem: str) -> None:
        self.plugin = plugin
        self.problem = problem
        super().__init__(plugin, problem)

    def __str__(self) -> str:
        problem = shortened(" ".join(self.problem.split()))
        if " of module " in self.plugin:  # the user's own
            return f"{self.plugin} breaks down ({problem}); repair it"
        return f"plug-in {self.plugin} breaks down ({problem}); repair or uninstall its package"


class ForeignFileError(_FileError, FileExistsError):
    """The path to write to holds something that vinefab did not write."""

    def __init__(
        self, path: str | Path, problem: str = "exists and was not written by vinefab"
    ) -> None:
        super().__init__(path, problem)

    def __str__(self) -> str:
        return f"{self.path}: {self.problem}; --force overwrites it (force=True in Python)"


class CannotWriteError(_FileError, OSError):
    """The system refused to write; existing files are unchanged."""

    def __str__(self) -> str:
        return f"{self.path}: cannot be written: {self.problem}"


class MissingPackageError(VinefabError, ImportError):
    """A package that vinefab needs for something is not installed."""

    def __init__(self, package: str, needed_for: str, extra: str = "") -> None:
        self.package = package
        self.needed_for = needed_for
        self.extra = extra  # of vinefab, which brings the package
        super().__init__(package, needed_for, extra)

    def __str__(self) -> str:
        brings = f"'vinefab[{self.extra}]'" if self.extra else self.package
        return f"{self.needed_for} needs {self.package}: pip install {brings}"


class NotCachedWarning(UserWarning):
    """The user's cache cannot be written to."""


class WorkersLostError(VinefabError, ConnectionError):
    """All workers are lost; finished work is kept."""

    def __init__(
        self, where: str, problem: str, advice: str = "--resume continues the recorded run"
    ) -> None:
        self.where = where
        self.problem = problem
        self.advice = advice
        super().__init__(where, problem, advice)

    def __str__(self) -> str:
        return f"{self.where}: {self.problem}; {self.advice}"


class InterruptedRunError(VinefabError, InterruptedError):
    """The user interrupted a command that can be resumed."""

    def __init__(self, done: str, command: str) -> None:
        self.done = done
        self.command = command
        super().__init__(done, command)

    def __str__(self) -> str:
        return f"interrupted; {self.done}; to resume: {self.command}"


class ExportRefusedError(VinefabError, ValueError):
    """What is to be made breaks rules, so no files were written.

    Parameters
    ----------
    name
        What was to be made.
    reason
        Why it is forbidden, as text.
    report
        The ``CheckReport`` with the findings, or None.
    summary
        What the rules say, a line each.
    """

    def __init__(
        self, name: str, reason: str, report: object = None, *, summary: tuple[str, ...] = ()
    ) -> None:
        self.name = name
        self.reason = reason
        self.report = report
        self.summary = summary
        super().__init__(name, reason, report)

    def __str__(self) -> str:
        return f"{self.name}: nothing written: {self.reason}"


class ReadBackError(_FileError, ValueError):
    """A file just written differs from its content when read back."""

    def __str__(self) -> str:
        return f"{self.path}: read back wrong: {self.problem}"


@contextmanager
def located(source: str | Path) -> Iterator[None]:
    """Add a file to the errors about wrong values and unknown names that a block raises.

    An error that already names its file keeps it.
    """
    try:
        yield
    except (BadInputError, UnknownNameError) as error:
        if error.source is not None:
            raise
        raise error.at(source) from None


@contextmanager
def inside(table: str) -> Iterator[None]:
    """Put the key of a table before the keys of the wrong values that a block finds in it."""
    try:
        yield
    except BadInputError as error:
        raise error.under(f"{table}.{error.key}", error.source) from None


class _NotShown:
    """Stands for a value that a message leaves out."""

    def __repr__(self) -> str:
        return "not shown"


@contextmanager
def values_hidden() -> Iterator[None]:
    """Leave values out of errors about a file that the user did not name: they may be secrets."""
    try:
        yield
    except UnfitInputError as error:
        problem = "does not fit (the values are not shown)"
        raise UnfitInputError(error.key, problem, error.allowed, error.source) from None
    except BadInputError as error:
        value = None if error.value is None else _NotShown()
        raise BadInputError(error.key, value, error.allowed, error.source) from None
    except UnknownNameError as error:
        raise UnknownNameError(error.kind, "(not shown)", error.known, error.source) from None


def nearest(name: str, known: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for the nearest known spelling, or an empty string.

    >>> nearest("lenght", ["length", "branches"])
    "; did you mean 'length'?"
    """
    small = {one.lower(): one for one in known}
    matches = get_close_matches(name.lower(), small, n=1, cutoff=0.6)
    return f"; did you mean {quoted(small[matches[0]])}?" if matches else ""


class _Beginning(Repr):
    """Writes only the beginning of a value: a whole one may be gigabytes, or not printable."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 4
        self.maxlist = self.maxtuple = self.maxdict = self.maxset = self.maxfrozenset = 24
        self.maxstring = 200
        self.maxother = 1 << 16

    def repr_str(self, x: str, level: int) -> str:
        return super().repr_str(readable(x), level)

    def repr_int(self, x: int, level: int) -> str:  # noqa: ARG002  reprlib passes it
        most_printed = 10**60
        if abs(x) < most_printed:
            return repr(x)
        digits_per_bit = 0.30103
        return f"a whole number of about {int(x.bit_length() * digits_per_bit)} digits"


_BEGINNING = _Beginning()


_MOST_LETTERS = 1_000
"""Of the words of other programs in one line."""


def shortened(text: str, most: int = 200) -> str:
    """Return a text that goes into one line, its middle left out if it is long."""
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"
