"""A verb: one public function that is a command too.

Its signature, its annotations and its docstring say all that the command line, its help and its
completion need. `verb` checks plain values for both doors, notes the call, from which "how to
reproduce" is written, and names values in errors as the caller names them. `Kind` says how a value
is typed in a shell; this module knows no library of command lines.
"""

import inspect
import re
import shlex
import textwrap
import warnings
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cache, wraps
from importlib import import_module
from os import PathLike, fspath
from pathlib import Path
from types import UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    ParamSpec,
    TypeVar,
    Union,
    get_args,
    get_origin,
)

from vinefab.core.errors import (
    BadInputError,
    BrokenPluginError,
    ExportRefusedError,
    UnfitInputError,
    UnknownNameError,
    VinefabError,
)
from vinefab.core.frozen import FrozenMapping
from vinefab.core.limits import MOST_SEED, number, whole
from vinefab.core.plain_text import readable
from vinefab.core.progress import Listener, Progress, heard_by, is_heard, progress_shown

P = ParamSpec("P")
R = TypeVar("R")

REQUIRED = inspect.Parameter.empty
_UNIT_AT_THE_END = re.compile(r"-(mm|deg|px)$")


# --- How a value is written ---------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """How a value is typed in a shell, and its allowed values in shell and Python."""

    metavar: str = ""
    read: Callable[[str], Any] | None = None  # one text as a value
    words: Callable[[Any], list[str]] | None = None  # a value as texts, the inverse of `read`
    gather: Callable[[list[Any]], Any] | None = None  # what was read of several texts as one value
    several: bool = False  # may be repeated
    known: Callable[[], Iterable[str]] | None = None  # names of registered parts, for the help too
    files: Callable[[], Iterable[str]] | None = None  # names of files that ship, or are the user's
    hyphen: bool = False  # a text may begin with a hyphen
    writes: Literal["", "file", "folder"] = ""
    ends: tuple[str, ...] = ()  # endings of a file that is written
    in_python: bool = False  # nothing that a shell could say


class Also(NamedTuple):
    """Older or shorter names of an option, which go on working."""

    flags: tuple[str, ...]


class InPlace(NamedTuple):
    """Marks a parameter that may be left out and is typed without its name all the same."""


IN_PLACE = InPlace()


def also(*flags: str) -> Also:
    """Return further names of an option, with their hyphens."""
    return Also(flags)


class Within(NamedTuple):
    """The limits of a number, both allowed."""

    low: float
    high: float
    unit: str = ""


class Doc(NamedTuple):
    """What a help says of a parameter; `typing_extensions.Doc` takes 17 ms to import."""

    documentation: str


class FieldsOf(NamedTuple):
    """Options of ``**options``: the fields of a class, ``module:Class``, except some."""

    where: tuple[str, ...]
    without: tuple[str, ...] = ()
    also: Mapping[str, tuple[str, ...]] = FrozenMapping()  # further flags by field
    kinds: Mapping[str, Kind] = FrozenMapping()  # how some fields are typed


Seed = Annotated[int, Within(0, MOST_SEED), Doc("The same seed gives the same result.")]
ProgressLike = Annotated[
    Callable[[Progress], None] | bool,
    Kind(in_python=True),
    Doc("True: a line in notebooks and on terminals after two seconds; False: nothing; a function: "
        "called with a Progress, the phase of the work and its count, whenever it changes."),
]  # fmt: skip
Force = Annotated[
    bool, Doc("Overwrite files that vinefab did not write, or that were changed since.")
]


# --- One option ---------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One parameter of a verb, or one field of its ``**options``, as both doors know it."""

    name: str
    base: Any  # bool, int, float, str, or anything else that `kind` reads
    kind: Kind
    default: Any = REQUIRED
    optional: bool = False  # None is allowed
    within: Within | None = None
    choices: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    positional: bool = False
    starred: bool = False  # ``*names``
    named: bool = False  # ``**parameters``, typed as NAME=VALUE
    help: str = ""

    @property
    def required(self) -> bool:
        """Whether it must be given."""
        return self.default is REQUIRED and not self.starred and not self.named

    @property
    def flag(self) -> str:
        """Its name in a shell."""
        return self.flags[-1 if self.named else 0]

    @property
    def shown(self) -> str:
        """Its name in messages of a shell: a word that stands by itself has no flag."""
        return self.name if self.positional else self.flag

    def shown_as(self, typed: Container[str]) -> str:
        """Return its name in messages about a command line: the flag that stands there."""
        return next((flag for flag in self.flags if flag in typed), self.shown)

    @property
    def metavar(self) -> str:
        """What stands for its value in a help."""
        plain = {int: "N", float: "NUMBER", str: "|".join(self.choices) or "TEXT"}
        return self.kind.metavar or plain.get(self.base, "VALUE")

    @property
    def hyphen(self) -> bool:
        """Whether its text may begin with a hyphen."""
        return self.kind.hyphen or self.base in (int, float)

    def read(self, text: str) -> Any:  # noqa: ANN401  of the option's own type
        """Return a text of a shell as a value."""
        if self.kind.read is not None:
            return self.kind.read(text)
        if self.base is int and not re.fullmatch(r"[+-]?\d{1,19}", text):
            raise BadInputError(self.name, text, f"a whole number{_without_unit(text)}")
        if self.base is float and not _NUMBER.fullmatch(text):
            raise BadInputError(self.name, text, f"a number{_without_unit(text)}")
        return self.base(text) if self.base in (int, float) else text

    def value(self, texts: list[str]) -> Any:  # noqa: ANN401  of the option's own type
        """Return typed texts, one or several, as the parameter's value."""
        try:
            values = [self.read(text) for text in texts]
            if self.kind.gather is not None:
                return self.kind.gather(values)
        except BadInputError as error:
            raise error.under(self.shown) from None
        return tuple(values) if self.kind.several or self.starred else values[-1]

    def words(self, value: Any) -> list[str]:  # noqa: ANN401  of the option's own type
        """Return the words to type for a value."""
        if self.base is bool:
            return [self.flag if value else f"--no-{self.flag[2:]}"]
        if self.kind.words is not None:
            texts = self.kind.words(value)
        elif self.kind.several or self.starred:
            alone = not isinstance(value, list | tuple | set)
            texts = [text_of(one) for one in ([value] if alone else value)]
        else:
            texts = [text_of(value)]
        if self.positional:
            return texts
        apart = [[f"{self.flag}={text}"] if text.startswith("-") else [self.flag, text]
                 for text in texts]  # fmt: skip
        return [word for pair in apart for word in pair]

    def checked(self, value: Any) -> Any:  # noqa: ANN401  of the option's own type
        """Return a plain value of the allowed kind and range, or raise BadInputError."""
        if value is None and self.optional:
            return None
        if self.kind.ends:
            return self._file(value)
        if self.base is bool and not isinstance(value, bool):
            raise BadInputError(self.name, value, "True or False")
        if self.choices and value not in self.choices:
            raise BadInputError(self.name, value, f"one of {', '.join(self.choices)}")
        if self.within is not None and self.base is int:
            most = int(self.within.high)
            try:
                return whole(self.name, value, int(self.within.low), most)
            except BadInputError:
                if most < MOST_SEED:
                    raise
                raise BadInputError(self.name, value, "a whole number, 0 or more") from None
        if self.within is not None and self.base is float:
            return number(self.name, value, self.within.low, self.within.high, self.within.unit)
        if self.base is str and not self.choices and not isinstance(value, str):
            raise BadInputError(self.name, value, "a name")
        return value

    def _file(self, value: Any) -> Any:  # noqa: ANN401  a path, or several
        several = self.kind.several and not isinstance(value, str | PathLike)
        for one in value if several else [value]:
            path = Path(one) if isinstance(one, str | PathLike) and fspath(one) else None
            if path is None or path.suffix.lower() not in self.kind.ends:
                allowed = f"a file name ending in {' or '.join(self.kind.ends)}"
                raise BadInputError(self.name, str(one) if path else one, allowed)
        return value


_NUMBER = re.compile(r"[+-]?(\d+\.?\d*([eE][+-]?\d+)?|\.\d+([eE][+-]?\d+)?|inf|nan)")
_WITH_UNIT = re.compile(r"[-+]?[\d.]+(?:e[-+]?\d+)?\s*[a-zA-Z%]+")


def _without_unit(text: str) -> str:
    return ", without a unit" if _WITH_UNIT.fullmatch(text) else ""


def text_of(value: object) -> str:
    """Return a plain value as a shell takes it: numbers without needless digits."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    if isinstance(value, bool):
        return str(value).lower()
    return str(value)


def registered_names(where: str) -> Callable[[], Iterable[str]]:
    """Return a function that lists a registry, ``module:NAME``, plug-ins included."""

    def listed() -> Iterable[str]:
        module, _, name = where.partition(":")
        registry: Any = getattr(import_module(module), name)
        if hasattr(registry, "load_plugins"):
            registry.load_plugins()
        return list(registry)

    return listed


def registered(option: Option) -> list[str]:
    """Return the names that are known for an option: registered parts, or files that ship."""
    listed = (one() for one in (option.kind.known, option.kind.files) if one is not None)
    return [*option.choices, *(name for names in listed for name in names)]


@cache
def options_of(function: Callable[..., Any]) -> tuple[Option, ...]:
    """Return the parameters of a verb as options, in the order of its signature."""
    function = inspect.unwrap(function)
    said = parameter_words(function)
    found = list[Option]()
    for parameter in inspect.signature(function).parameters.values():
        hint = _hint(parameter, function)
        marks = _marks(hint)
        listed = next((mark for mark in marks if isinstance(mark, FieldsOf)), None)
        if listed is not None:
            for where in listed.where:
                module, _, name = where.partition(":")
                for one in field_options(getattr(import_module(module), name), listed.without):
                    flags = (*one.flags, *listed.also.get(one.name, ()))
                    kind = listed.kinds.get(one.name, one.kind)
                    found.append(replace(one, flags=flags, kind=kind))
            continue
        option = _option(parameter.name, hint, parameter.default, said.get(parameter.name, ""))
        starred = parameter.kind is parameter.VAR_POSITIONAL
        found.append(
            replace(
                option,
                starred=starred,
                named=parameter.kind is parameter.VAR_KEYWORD,
                positional=starred
                or IN_PLACE in marks
                or (parameter.default is REQUIRED
                    and parameter.kind is parameter.POSITIONAL_OR_KEYWORD),
            )
        )  # fmt: skip
    return tuple(found)


def _hint(parameter: inspect.Parameter, function: Any) -> Any:  # noqa: ANN401  an annotation
    """Return an annotation of a verb: other names in a signature are for type checkers alone."""
    hint = parameter.annotation
    return eval(hint, function.__globals__) if isinstance(hint, str) else hint  # noqa: S307  ours


def field_options(kind: Any, without: tuple[str, ...] = ()) -> Iterator[Option]:  # noqa: ANN401
    """Yield an option for each field of a dataclass or a declared table, except some."""
    said = parameter_words(kind)
    if is_dataclass(kind):
        defaults = {one.name: one.default for one in fields(kind)}
    else:
        defaults = {name: one.default for name, one in kind.model_fields.items()}
    for name, default in defaults.items():
        if name not in without:
            given = None if default is MISSING else default
            words = said.get(name, "")
            if words and not is_dataclass(kind):  # declared meanings are no sentences
                words = f"{words[:1].upper()}{words[1:].removesuffix('.')}."
            yield _option(name, _field_hint(kind, name), given, words)


def _field_hint(kind: type, name: str) -> Any:  # noqa: ANN401  an annotation
    """Return the annotation of one field: others may name what only type checkers load."""
    home = next(one for one in kind.__mro__ if name in inspect.get_annotations(one))
    hint = inspect.get_annotations(home)[name]
    if not isinstance(hint, str):
        return hint
    return eval(hint, vars(import_module(home.__module__)))  # noqa: S307  our own source


def _option(name: str, hint: Any, default: Any, words: str) -> Option:  # noqa: ANN401
    marks, inner, optional = _marks(hint), hint, default is None
    while get_origin(inner) is Annotated or get_origin(inner) in (Union, UnionType):
        parts = [one for one in get_args(inner) if one is not type(None)]
        optional = optional or type(None) in get_args(inner)
        if get_origin(inner) is not Annotated and len(parts) > 1:
            break
        inner = parts[0]
    choices: tuple[str, ...] = ()
    if get_origin(inner) is Literal:
        choices, inner = get_args(inner), str
    kind = next((mark for mark in marks if isinstance(mark, Kind)), None)
    if kind is None:
        kind = numbers_kind(hint) if get_origin(inner) is tuple else Kind()
    plain = f"--{name.replace('_', '-')}"
    older = [flag for mark in marks if isinstance(mark, Also) for flag in mark.flags]
    return Option(
        name=name,
        base=inner if inner in (bool, int, float, str) else object,
        kind=kind,
        default=default,
        optional=optional,
        within=next((mark for mark in marks if isinstance(mark, Within)), None),
        choices=choices,
        flags=tuple(dict.fromkeys([plain, *older, _UNIT_AT_THE_END.sub("", plain)])),
        help=words or _documentation(marks),
    )


def _documentation(marks: list[Any]) -> str:
    return next((mark.documentation for mark in marks if hasattr(mark, "documentation")), "")


def _marks(hint: Any) -> list[Any]:  # noqa: ANN401  whatever is annotated
    """Return the marks of an annotation, the outermost first, those inside a union too."""
    if get_origin(hint) is Annotated:
        base, *marks = get_args(hint)
        return [*reversed(marks), *_marks(base)]
    if get_origin(hint) in (Union, UnionType):
        return [mark for one in get_args(hint) for mark in _marks(one)]
    return []


def numbers_from(text: str, count: int = 0) -> tuple[float, ...]:
    """Return numbers from a text like ``400,300``; count 0: any number of them."""
    parts = text.split(",")
    plain = all(_NUMBER.fullmatch(part.strip()) for part in parts)
    if not plain or (count and len(parts) != count):
        how_many = f"{count} " if count else ""
        raise BadInputError("", text, f"{how_many}finite numbers with commas between them")
    return tuple(float(part) for part in parts)


def numbers_kind(hint: Any) -> Kind:  # noqa: ANN401  an annotation
    """Return the kind of a tuple of numbers: ``400,300``."""
    tuples = [one for one in (hint, *get_args(hint)) if get_origin(one) is tuple]
    parts = get_args(tuples[0]) if tuples else ()
    if parts and all(one in (int, float) for one in parts):
        count = len(parts)
        return Kind(
            metavar=",".join("N" * count),
            read=lambda text: numbers_from(text, count),
            words=lambda value: [",".join(map(text_of, value))],
            hyphen=True,
        )
    return Kind(metavar="TEXT", several=bool(parts) and parts[-1] is Ellipsis)


# --- Docstrings ---------------------------------------------------------------------------------


def parameter_words(thing: Any) -> dict[str, str]:  # noqa: ANN401  a class or a function
    """Return the docstrings' text on each parameter; a class inherits those of its bases."""
    found: dict[str, str] = {}
    for one in reversed(getattr(thing, "__mro__", (thing,))):
        block = _section(inspect.getdoc(one) or "", "Parameters")
        for names, words in re.findall(
            r"^(\*{0,2}\w[\w, ]*)\n((?:[ \t]+.*\n?|\n)+)", block, re.MULTILINE
        ):
            said = " ".join(words.split())
            found |= dict.fromkeys((name.strip("* ") for name in names.split(",")), said)
    return found


def _with_parameters(function: Callable[..., Any]) -> str | None:
    """Return a verb's docstring with the words that its annotations say of parameters."""
    text, own = inspect.getdoc(function), parameter_words(function)
    if text is None:  # python -OO
        return None
    entries = list[str]()
    for parameter in inspect.signature(function).parameters.values():
        words = own.get(parameter.name) or _documentation(_marks(_hint(parameter, function)))
        entries.append(str(parameter.replace(annotation=REQUIRED, default=REQUIRED)))
        entries += textwrap.wrap(words, 96, initial_indent="    ", subsequent_indent="    ",
                                 break_on_hyphens=False)  # fmt: skip
    if not entries:
        return text
    head, *sections = re.split(r"\n\n(?=[A-Z]\w+\n-{3,}\n)", text)
    others = [one for one in sections if not one.startswith("Parameters\n")]
    return "\n\n".join([head, "\n".join(["Parameters", "----------", *entries]), *others])


def described(function: Callable[..., Any]) -> tuple[str, str]:
    """Return a docstring without its sections: first line, and the rest."""
    text = re.split(r"\n\w+\n-{3,}\n", inspect.getdoc(function) or "", maxsplit=1)[0]
    first, _, rest = text.partition("\n\n")
    return " ".join(first.split()), rest.strip()


def shell_examples(function: Callable[..., Any]) -> list[str]:
    """Return the command lines among the examples of a function: ``$ vinefab ...``."""
    block = _section(inspect.getdoc(function) or "", "Examples")
    return [" ".join(one.split()) for one in re.findall(r"^\$ (.+(?:\n  +.+)*)", block, re.M)]


def _section(text: str, title: str) -> str:
    found = re.search(rf"(?:^|\n){title}\n-+\n(.*?)(?=\n\n[A-Z]\w+\n-+\n|\Z)", text, re.DOTALL)
    return found[1] if found else ""


# --- One call -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Shell:
    """The command line that calls a verb: its output and its progress bar."""

    command: str  # the words of the command: ``map info``
    say: Callable[[str], None]
    progress: Callable[[str], AbstractContextManager[Listener]]
    gives_json: bool = False  # whether ``--json`` is given
    typed: frozenset[str] = frozenset()  # the flags, as they were typed


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """A call of a verb, in the words of the one who made it."""

    function: Callable[..., Any]
    given: Mapping[str, Any]  # by parameter, fields of ``**options`` among them
    shell: Shell | None = None

    @property
    def changed(self) -> dict[str, Any]:
        """What was given other than the defaults, by parameter."""
        known = {one.name: one.default for one in options_of(self.function)}
        return {
            name: value
            for name, value in self.given.items()
            if name not in known or not _same(value, known[name])
        }

    def text(self, **changes: object) -> str:
        """Return the call as text: a command line, or a line of Python.

        Parameters
        ----------
        **changes
            Other values of some parameters.
        """
        given = {**self.given, **changes}
        for name in ("force", "progress"):  # nothing of the result depends on them
            given.pop(name, None)
        call = Call(function=self.function, given=given)
        return call._written() if self.shell is None else readable(call.typed(self.shell.command))

    def to(self, function: Callable[..., Any], **given: Any) -> "Call":  # noqa: ANN401
        """Return a call of another verb by the same caller."""
        command = function.__name__.replace("_", "-")
        shell = self.shell and replace(self.shell, command=command)
        return Call(function=function, given=given, shell=shell)

    def typed(self, command: str) -> str:
        """Return the call as a command line; ``command`` is how a shell calls the verb."""
        words, after, given = ["vinefab", *command.split()], list[str](), self.given
        for option in options_of(self.function):
            if option.named:
                known = {one.name for one in options_of(self.function)}
                rest = {name: value for name, value in given.items() if name not in known}
                after += option.words(rest) if rest else []
            elif option.name in given and not _same(given[option.name], option.default):
                (words if option.positional else after).extend(option.words(given[option.name]))
        return shlex.join([*words, *after])

    def _written(self) -> str:
        room = "maps." if self.function.__module__.endswith(".maps") else ""
        in_place = {one.name for one in options_of(self.function) if one.positional}
        parts = [
            _shown(value) if name in in_place else f"{name}={_shown(value)}"
            for name, value in self.changed.items()
        ]
        return f"vf.{room}{self.function.__name__}({', '.join(parts)})"


def _same(value: object, default: object) -> bool:
    if value is default:
        return True
    plain = isinstance(value, bool | int | float | str | tuple | PathLike | None)
    return plain and type(value) is type(default) and value == default


def _shown(value: Any) -> str:  # noqa: ANN401  whatever was passed
    if isinstance(value, PathLike):
        return repr(fspath(value))
    if isinstance(value, str | int | float | None):
        return repr(value)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name!r}: {_shown(one)}" for name, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        shown = ", ".join(map(_shown, value))
        return f"[{shown}]" if isinstance(value, list) else f"({shown})"
    return f"<{type(value).__name__} {getattr(value, 'name', '')}>".replace(" >", ">")


_CALL: ContextVar[Call] = ContextVar("call")
SHELL: ContextVar[Shell | None] = ContextVar("shell", default=None)


def this_call() -> Call:
    """Return the call of the verb that is running."""
    return _CALL.get()


def verb(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function a verb: see the module."""
    signature = inspect.signature(function)
    function.__doc__ = _with_parameters(function)

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        bound, shell = signature.bind(*args, **kwargs), SHELL.get()
        known = {option.name: option for option in options_of(function)}
        given = dict[str, Any]()
        try:
            for name, value in bound.arguments.items():
                if signature.parameters[name].kind is inspect.Parameter.VAR_KEYWORD:
                    for field, one in value.items():
                        value[field] = known[field].checked(one) if field in known else one
                    given |= value
                    continue
                if name in known and not known[name].starred:
                    value = known[name].checked(value)  # noqa: PLW2901  numbers of numpy
                    bound.arguments[name] = value
                given[name] = value
            token = _CALL.set(Call(function=function, given=given, shell=shell))
            try:
                return function(*bound.args, **bound.kwargs)
            finally:
                _CALL.reset(token)
        except BrokenPluginError:  # its author reads the whole traceback
            raise
        except VinefabError as error:
            raise _renamed(error, function, shell=shell) from None

    return called


def _renamed(
    error: VinefabError,
    function: Callable[..., Any],
    *,
    shell: Shell | None,
) -> VinefabError:
    """Return an error that names parameters as the caller knows them."""
    if shell is not None:
        typed = shell.typed
        flags = {one.name: one.shown_as(typed) for one in options_of(function)}
        if isinstance(error, BadInputError) and error.source is None and error.key in flags:
            return error.under(flags[error.key])
        return error
    if isinstance(error, ExportRefusedError):
        why = _as_parameters(error.reason)
        return ExportRefusedError(error.name, why, error.report, summary=error.summary)
    if not isinstance(error, UnknownNameError | BadInputError):
        return error
    source = None if str(error.source).startswith("--") else error.source
    if isinstance(error, UnknownNameError):
        return UnknownNameError(error.kind, error.name, error.known, source, error.problem)
    key, allowed, given = _as_parameters(error.key), _as_parameters(error.allowed), error.value
    if isinstance(error, UnfitInputError):
        return UnfitInputError(key, _as_parameters(str(given)), allowed, source)
    return BadInputError(key, given, allowed, source)


def _as_parameters(words: str) -> str:
    return re.sub(r"--([a-z][a-z0-9-]*)", lambda option: option[1].replace("-", "_"), words)


def note(text: str, *, only_in_shell: bool = False) -> None:
    """Tell the caller more than the result: a line in a shell, a warning in Python."""
    shell = SHELL.get()
    if shell is not None:
        shell.say(text)
    elif not only_in_shell:
        warnings.warn(text, stacklevel=5)


def wrote(path: str | PathLike[str], words: str = "") -> None:
    """Tell a shell what was written."""
    note(f"wrote {fspath(path)}{words}", only_in_shell=True)


@contextmanager
def told(progress: object) -> Iterator[None]:
    """Let the caller hear the progress of a block: a function, or who watches or reads a line.

    A verb that is called by another one has its listener.
    """
    call, shell = this_call(), SHELL.get()
    if callable(progress):
        with heard_by(progress):
            yield
        return
    if not isinstance(progress, bool | None):
        raise BadInputError("progress", progress, "True, False, or a function")
    if is_heard() or not progress:
        yield
        return
    title = call.function.__name__ if shell is None else shell.command
    shown = progress_shown(title) if shell is None else shell.progress(title)
    with shown as listener, heard_by(listener):
        yield
