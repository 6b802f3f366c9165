"""Commands from verbs: which one is meant, its typed values, its result; and shell completion."""

import difflib
import os
import re
import shlex
import sys
from collections import deque
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import copy_context
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO, get_args

from vinefab.app.verbs import GROUPS, HELP, PER_NAME, SHORT, VERBS, loaded
from vinefab.core.atomic import ensure_writable, write_text
from vinefab.core.errors import ExportRefusedError, VinefabError, shortened
from vinefab.core.plain_text import quoted, visible
from vinefab.core.progress import (
    SHOWN_AFTER_S,
    Listener,
    ProgressLine,
    progress_in_lines,
    ticking,
)
from vinefab.core.verbs import (
    SHELL,
    Force,
    Kind,
    Option,
    Shell,
    described,
    field_options,
    options_of,
    registered,
    shell_examples,
)
from vinefab.model.inputs import MAP_SUFFIXES

_COLOURS = {
    "ERROR": "1;31",
    "warn": "33",
    "waived": "36",
    **dict.fromkeys(("info", "ran", "note", "limit", "skipped", "next:"), "2"),
}
"""Colours of lines by their first word; the words say the same where there is no colour."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Terminal:
    """Where a command's messages, results and progress go."""

    quiet: bool = False  # print nothing but errors
    # where the machine-readable result goes; with ``-`` messages go to standard error
    json_out: str | None = None
    force: bool = False  # overwrite files that vinefab did not write

    def say(self, text: str = "") -> None:
        """Print a line for the user, without anything that a terminal would obey."""
        stream = sys.stderr if self.json_out == "-" else sys.stdout
        if self.quiet or stream is None:
            return
        colour = _COLOURS.get(text.partition(" ")[0])
        shown = visible(text)
        if colour and stream.isatty():
            shown = f"\033[{colour}m{shown}\033[0m"
        stream.write(f"{shown}\n")

    def say_all(self, lines: Iterable[str]) -> None:
        """Print some lines."""
        for line in lines:
            self.say(line)

    def ensure_json(self) -> None:
        """Check, before work that takes long, that `give_json` will be able to write."""
        if self.json_out not in (None, "-"):
            ensure_writable(Path(str(self.json_out)), force=self.force)

    def give_json(self, text: str) -> None:
        """Write the machine-readable result, which was asked for."""
        if self.json_out == "-":
            sys.stdout.write(text)
        else:
            write_text(Path(str(self.json_out)), text, force=self.force)
            self.say(f"wrote {self.json_out}")

    @contextmanager
    def progress(self, title: str) -> Iterator[Listener]:
        """Show phase, count, a bar and the time left on a terminal, elsewhere some lines."""
        stream = sys.stderr if self.json_out == "-" else sys.stdout
        if self.quiet:
            yield lambda _progress: None
            return
        if stream is None or not stream.isatty():
            with progress_in_lines(title) as listener:
                yield listener
            return
        line, bars = ProgressLine(title), list[Any]()

        def look() -> None:
            if line.elapsed_s < SHOWN_AFTER_S:
                return
            if not bars:  # only somebody who watches waits for rich
                bars.append(_begun_bar(line, stream))
            now = line.now
            share = None if now is None else now.share
            bars[0].tasks[0].total = None if share is None else 1.0  # without one it pulses
            bars[0].update(
                bars[0].task_ids[0],
                description=visible(title if now is None else f"{title}: {now.count}"),
                completed=share or 0.0,
                words="" if now is None else visible(now.words),
            )

        try:
            with ticking(look):
                yield line.hear
        finally:
            for bar in bars:
                bar.stop()


def _begun_bar(line: ProgressLine, stream: TextIO) -> Any:  # noqa: ANN401  of rich, loaded late
    """Return a bar that is shown on a terminal until it is stopped."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, Task, TextColumn
    from rich.text import Text

    class Times(TextColumn):
        """Time so far and left, as they are when it is drawn."""

        def render(self, task: Task) -> Text:  # noqa: ARG002  of one task
            return Text(line.times)

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        Times(""),
        TextColumn("{task.fields[words]}", markup=False),
    )
    console = Console(file=stream, highlight=False)
    bars = Progress(*columns, console=console, transient=True)
    bars.add_task("", total=None, words="")
    bars.start()
    return bars


_SEVERAL = {
    **dict.fromkeys(("--maps", "--map"), rf"[^-].*({'|'.join(map(re.escape, MAP_SUFFIXES))})"),
    **dict.fromkeys(("--targets", "--target"), r"([^-=][^=]*=)?-?[\d.]+,-?[\d.]+(\+-[\d.]+)?"),
}
"""Options that take several values, and how a value looks."""

_LIKE_OPTION = re.compile(r"--?[a-zA-Z]")

_ALIKE = 0.75
"""So alike are two names at least of which one may be meant for the other, 0 to 1."""


class UsageError(VinefabError):
    """A command line that cannot be understood."""


COMMON = (
    Option(
        name="json",
        base=str,
        kind=Kind(metavar="FILE", hyphen=True),
        default=None,
        flags=("--json",),
        help="Machine-readable result: a file, or - for the output.",
    ),
    Option(
        name="quiet",
        base=bool,
        kind=Kind(),
        default=False,
        flags=("--quiet", "-q"),
        help="Print nothing but errors.",
    ),
    Option(
        name="verbose",
        base=bool,
        kind=Kind(),
        default=False,
        flags=("--verbose", "-v"),
        help="Print more, where there is more.",
    ),
)
"""What every command has; `--force` too, for the file of ``--json``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """One command: a verb with the words that call it."""

    name: str
    function: Callable[..., Any]
    options: tuple[Option, ...]
    fixed: Mapping[str, Any] = field(default_factory=dict)  # parameters that its name says
    about: str = ""  # in place of the first sentence of the function's docstring

    @classmethod
    def named(cls, name: str) -> "Command":
        """Return the command of some words, ``map grid``."""
        if name in VERBS:
            function = VERBS[name].function
            return cls(name=name, function=function, options=_shell_options(options_of(function)))
        group, _, last = name.partition(" ")
        where, registry = PER_NAME[group]
        function, part = loaded(where), loaded(registry)[last]
        first, *rest = options_of(function)
        own = [one for one in rest if not one.named]
        return cls(
            name=name,
            function=function,
            options=_shell_options((*own, *field_options(part.options))),
            fixed={first.name: last},
            about=f"Generate a map: {part.description}.",
        )

    def examples(self) -> list[str]:
        """Return command lines that work."""
        if self.fixed:
            return [f"vinefab {self.name} --seed 3 --out {self.name.split()[-1]}.geojson"]
        return shell_examples(self.function)

    def description(self) -> tuple[str, str]:
        """Return its purpose in one sentence, and the rest."""
        return (self.about, "") if self.about else described(self.function)

    def run(self, typed: Sequence[str]) -> int:
        """Run the command as it was typed, and return the exit code."""
        given = self.understood(typed)
        json_out, quiet = given.pop("json", None), given.pop("quiet", False)
        verbose = given.pop("verbose", False)
        force = given["force"] if self._forces else given.pop("force", False)
        terminal = Terminal(quiet=quiet, json_out=json_out, force=bool(force))
        terminal.ensure_json()
        context = copy_context()
        flags = frozenset(flags_in(typed))
        return context.run(self._called, given, terminal, flags, verbose=verbose)

    @property
    def _forces(self) -> bool:
        return any(one.name == "force" for one in self.options)

    def _called(
        self, given: dict[str, Any], terminal: Terminal, typed: frozenset[str], *, verbose: bool
    ) -> int:
        shell = Shell(
            command=self.name,
            say=terminal.say,
            progress=terminal.progress,
            gives_json=terminal.json_out is not None,
            typed=typed,
        )
        SHELL.set(shell)
        placed = [given.pop(one.name) for one in self.options if one.starred and one.name in given]
        try:
            result = self.function(*(placed[0] if placed else ()), **self.fixed, **given)
        except ExportRefusedError as error:
            terminal.say_all(error.summary)
            raise
        if result is None:
            return 0
        if terminal.json_out is not None:
            terminal.give_json(result.json_text())
        details = getattr(result, "details", None) if verbose else None
        terminal.say_all(details if isinstance(details, tuple) else result.summary)
        return int(getattr(result, "exit_code", 0))

    def understood(self, typed: Sequence[str]) -> dict[str, Any]:
        """Return the values that were typed, by parameter."""
        texts = self._parsed(typed)
        missing = [one for one in self.options if one.required and one.name not in texts]
        if missing:
            shown = missing[0].metavar if missing[0].positional else missing[0].flag
            raise self._misused(f"{shown} is missing")
        given = dict[str, Any]()
        for option in all_options(self):
            if option.name not in texts:
                continue
            found = texts[option.name]
            value: Any = found if isinstance(found, bool) else option.value(found)
            if option.named:
                given |= value
            else:
                given[option.name] = value
        if self._forces:
            given.setdefault("force", False)
        return given

    def _parsed(self, typed: Sequence[str]) -> dict[str, Any]:
        """Return the texts that were typed for each option, or whether it was, by parameter."""
        options = all_options(self)
        named = {flag: one for one in options for flag in flags_of(one)}
        words, loose, found = deque(typed), list[str](), dict[str, Any]()
        while words:
            word = words.popleft()
            if word == "--":
                loose += words
                break
            if re.fullmatch(r"-[a-z]{2,}", word) and all(f"-{one}" in named for one in word[1:]):
                words.extendleft(f"-{one}" for one in reversed(word[1:]))
                continue
            flag, equals, text = word.partition("=")
            option = named.get(flag)
            if option is None and _LIKE_OPTION.match(word):
                raise UsageError(self._unknown(flag, [*named, *HELP]))
            if option is None:
                loose.append(word)
                continue
            if option.name in found and not option.kind.several:
                raise UsageError(f"{flag} is given twice; allowed: once")
            if option.base is bool:
                if equals and text not in ("true", "false"):
                    raise self._misused(f"{flag} is {shortened(text)!r}; allowed: true or false")
                found[option.name] = (text == "false") != (flag in option.flags)
                continue
            if not equals and (not words or not _may_follow(option, words[0])):
                raise self._misused(f"{flag} is without a value")
            texts = found.setdefault(option.name, [])
            texts.append(text if equals else words.popleft())
            # A shell makes ``--maps a.geojson b.geojson`` of ``--maps *.geojson``.
            more = _SEVERAL.get(flag) if option.kind.several else None
            while more and words and re.fullmatch(more, words[0]):
                texts.append(words.popleft())
        return found | self._placed(loose, found)

    def _placed(self, texts: Sequence[str], named: Container[str]) -> dict[str, list[str]]:
        """Return the texts that stand without a name, by the parameters that none names."""
        found, loose = dict[str, list[str]](), deque(texts)
        for option in self.options:
            if option.positional and option.name not in named and loose:
                many = len(loose) if option.starred or option.kind.several else 1
                found[option.name] = [loose.popleft() for _ in range(many)]
        if loose:
            raise self._misused(f"one argument too many: {shortened(' '.join(loose))}")
        return found

    def _misused(self, line: str) -> UsageError:
        """Return the error of a command line, with one that works."""
        examples = self.examples()
        return UsageError(f"{line}; for example: {examples[0]}" if examples else line)

    def _unknown(self, flag: str, flags: Sequence[str]) -> str:
        known = [one for one in flags if one.startswith("--")]
        begun = [one for one in known if len(flag) > 3 and one.startswith(flag)]
        if alike := begun or difflib.get_close_matches(flag, known, cutoff=_ALIKE):
            return f"there is no option {flag}; did you mean {' or '.join(alike)}?"
        return f"there is no option {shortened(flag, 80)}; vinefab {self.name} --help lists them"


def _may_follow(option: Option, word: str) -> bool:
    """Return whether a word may be the value of the option before it."""
    is_option = word == "--" or _LIKE_OPTION.match(word)
    return not is_option and (option.hyphen or not word.startswith("-"))


def _common(options: Sequence[Option]) -> tuple[Option, ...]:
    if any(one.name == "force" for one in options):
        return COMMON
    words = get_args(Force)[1].documentation
    more = Option(
        name="force", base=bool, kind=Kind(), default=False, flags=("--force",), help=words
    )
    return (*COMMON, more)


def all_options(command: Command) -> tuple[Option, ...]:
    """Return the options of a command, with those that every command has."""
    return (*command.options, *_common(command.options))


def flags_in(typed: Sequence[str]) -> list[str]:
    """Return the names of options in a command line, as they were typed."""
    return [word.partition("=")[0] for word in typed if _LIKE_OPTION.match(word)]


def flags_of(option: Option) -> tuple[str, ...]:
    """Return every way to type an option's name."""
    if option.base is bool and option.default is True:
        return (*option.flags, *(f"--no-{flag[2:]}" for flag in option.flags))
    many = option.starred or (option.positional and option.kind.several)
    return () if many else option.flags


def _shell_options(options: Sequence[Option]) -> tuple[Option, ...]:
    """Return the options that can be typed; no two share a name."""
    taken = {option.flag for option in options}
    found = list[Option]()
    for option in options:
        if option.kind.in_python:
            continue
        flags = [option.flag]
        if option.named:
            flags = list(option.flags[1:]) or flags
        else:
            flags += [flag for flag in option.flags[1:] if flag not in taken]
        taken |= set(flags)
        found.append(replace(option, flags=tuple(flags)))
    return tuple(found)


def names_in(group: str) -> Iterator[str]:
    """Yield the names of the commands in a group, those of registered parts first."""
    if group in PER_NAME:
        registry = loaded(PER_NAME[group][1])
        registry.load_plugins()
        yield from registry
    for name in VERBS:
        before, _, last = name.rpartition(" ")
        if before == group:
            yield last


def summaries(group: str) -> dict[str, str]:
    """Return the commands of a group with a line on each."""
    found = dict[str, str]()
    if group in PER_NAME:
        registry = loaded(PER_NAME[group][1])
        registry.load_plugins()
        found |= {name: f"Generate a map: {part.description}." for name, part in registry.items()}
        found |= {name: f"does not load ({why})" for name, why in registry.broken.items()}
    for name, verb in VERBS.items():
        before, _, last = name.rpartition(" ")
        if before == group:
            found[last] = verb.summary
    return found


def command_for(words: Sequence[str]) -> tuple[str, list[str]]:
    """Return the name of the command that is meant, and the words for it.

    A group alone, or one that asks for help, is returned with no words or ``--help``.

    Raises
    ------
    UsageError
        If there is no such command.
    """
    first, *rest = words
    if first.startswith("-"):
        raise UsageError(
            f"there is no option {first} before a command; vinefab COMMAND {first} ..."
        )
    if first in SHORT:
        first, *group = SHORT[first].split()
        rest = [*group, *rest]
    if first in GROUPS:
        if not rest or rest[0] in HELP:
            return first, rest[:1]
        last, *rest = rest
        if f"{first} {last}" not in VERBS and last not in (known := list(names_in(first))):
            raise UsageError(_unknown_command(last, known))
        return f"{first} {last}", rest
    if first not in VERBS or " " in first:
        raise UsageError(_unknown_command(first, top_commands()))
    return first, rest


def top_commands() -> list[str]:
    """Return the words that may stand first, in the order of the help."""
    names = [name.split()[0] for name in VERBS]
    return list(dict.fromkeys(names))


def _unknown_command(typed: str, known: Sequence[str]) -> str:
    meant = difflib.get_close_matches(typed.lower(), known, cutoff=_ALIKE)
    if meant:
        hint = f"did you mean {' or '.join(map(quoted, meant))}?"
    else:
        hint = f"there are: {', '.join(known)}"
    return f"there is no command {quoted(shortened(typed, 80))}; {hint}"


SCRIPTS = {
    "bash": """_vinefab_complete() {
  local IFS=$'\\n'
  COMPREPLY=($(_VINEFAB_COMPLETE=1 vinefab "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null))
}
complete -o default -o bashdefault -F _vinefab_complete vinefab
""",
    "zsh": """#compdef vinefab
_vinefab_complete() {
  local -a found
  found=("${(@f)$(_VINEFAB_COMPLETE=1 vinefab "${(@)words[2,CURRENT]}" 2>/dev/null)}")
  if [[ -n "$found" ]]; then compadd -a found; else _files; fi
}
if [[ $zsh_eval_context[-1] == loadautofunc ]]; then
  _vinefab_complete
else
  compdef _vinefab_complete vinefab
fi
""",
    "fish": """complete -c vinefab -a '(_VINEFAB_COMPLETE=1 vinefab """
    """(commandline -opc)[2..-1] (commandline -ct) 2>/dev/null)'
""",
}
_HOMES = {
    "bash": ".bash_completions/vinefab.sh",
    "zsh": ".zfunc/_vinefab",
    "fish": ".config/fish/completions/vinefab.fish",
}


def completions(words: Sequence[str]) -> list[str]:
    """Return the possible completions of the last of some words.

    >>> completions(["fabr"])
    ['fabricate']
    """
    *before, half = words or [""]
    return sorted({word for word in _possible(before, half) if word.startswith(half)})


def _possible(before: list[str], half: str) -> list[str]:
    if not before:
        return [*top_commands(), *HELP, "--version"] if half.startswith("-") else top_commands()
    if before == [before[0]] and before[0] in GROUPS:
        return [*names_in(before[0]), *HELP]
    try:
        name, typed = command_for(before)
        command = Command.named(name)
    except UsageError:
        return []
    options = all_options(command)
    flag, equals, value = half.partition("=")
    last = flag if equals else (typed[-1] if typed else "")
    asked = next((one for one in options if last in flags_of(one) and one.base is not bool), None)
    if asked is not None:
        found = registered(asked)
        return [f"{flag}={word}" for word in found] if equals and value is not None else found
    if half.startswith("-"):
        return [*(flag for one in options for flag in flags_of(one)), *HELP]
    places = [one for one in options if one.positional]
    stands = [word for word in typed if not word.startswith("-")]
    return registered(places[min(len(stands), len(places) - 1)]) if places else []


def shell_name() -> str:
    """Return the shell that runs this program, bash where it is not known."""
    name = Path(os.environ.get("SHELL", "bash")).name
    return name if name in SCRIPTS else "bash"


def script_for(shell: str) -> str:
    """Return the script by which a shell asks."""
    if shell not in SCRIPTS:
        raise UsageError(f"no completion for {quoted(shell)}; there are: {', '.join(SCRIPTS)}")
    return SCRIPTS[shell]


def install(shell: str) -> str:
    """Write the script where the shell finds it, and return what to say."""
    text, home = script_for(shell), Path.home()
    path = home / _HOMES[shell]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    begins = {
        "bash": (home / ".bashrc", f"source {shlex.quote(str(path))}"),
        "zsh": (home / ".zshrc", "fpath+=~/.zfunc; autoload -Uz compinit; compinit"),
    }
    if shell in begins:
        start, line = begins[shell]
        there = start.read_text(encoding="utf-8") if start.is_file() else ""
        if line not in there.splitlines():
            start.write_text(f"{there}\n{line}\n", encoding="utf-8")
    return f"{shell} completion installed in {path}; it works in new terminals"


def answer(words: Sequence[str]) -> int:
    """Print what the last word may become: a shell asks."""
    sys.stdout.write("".join(f"{word}\n" for word in completions(words)))
    return 0
