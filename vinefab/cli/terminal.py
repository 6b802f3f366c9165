"""What a command prints: messages, its result, and progress."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from vinefab.core.atomic import ensure_writable, write_text
from vinefab.core.plain_text import visible
from vinefab.core.progress_lines import progress_in_lines

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
    def progress(self, title: str) -> Iterator[Callable[[float, str], None]]:
        """Show a bar with the time left on a terminal while a block runs, elsewhere some lines."""
        stream = sys.stderr if self.json_out == "-" else sys.stdout
        if self.quiet:
            yield lambda _share, _words: None
            return
        if stream is None or not stream.isatty():
            with progress_in_lines(title) as tell:
                yield tell
            return
        # Only somebody who watches waits for rich.
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            Progress,
            TextColumn,
            TimeRemainingColumn,
        )

        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            TextColumn("{task.fields[text]}", markup=False),
            TimeRemainingColumn(),
        )
        console = Console(file=stream, highlight=False)
        with Progress(*columns, console=console, transient=True) as bar:
            task = bar.add_task(visible(title), total=1.0, text="")
            yield lambda share, text: bar.update(task, completed=share, text=visible(text))
