"""What a shell completes: commands, options, and names of files and parts; asked word by word.

A shell asks by the environment variable ``_VINEFAB_COMPLETE``: the words are the arguments, the
last of them half typed.
"""

import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from vinefab.app.verbs import GROUPS, HELP
from vinefab.cli.commands import (
    Command,
    UsageError,
    all_options,
    command_for,
    flags_of,
    names_in,
    top_commands,
)
from vinefab.core.verbs import registered

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
        raise UsageError(f"no completion for {shell!r}; there are: {', '.join(SCRIPTS)}")
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
