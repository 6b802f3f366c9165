"""``vinefab examples``: run files and scripts that ship with vinefab."""

from itertools import takewhile
from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import CommandOutput, Force, Quiet
from vinefab.model.files.shipped import read_text
from vinefab.model.files.starters import copy_examples, examples_named

TEXTS = (".toml", ".py", ".sbatch", ".md")


def examples_command(
    *,
    names: Annotated[
        list[str] | None, typer.Argument(metavar="NAME", help="Examples to copy; default: all.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Copy them into this folder; default: list them.")
    ] = None,
    quiet: Quiet = False,
    force: Force = False,
) -> int:
    """List the examples that ship with vinefab, or copy them to try and change.

    Example: vinefab examples --out examples
    """
    output = CommandOutput(quiet=quiet, force=force)
    chosen = examples_named(names or [])
    if out is None:
        for name, path in chosen.items():
            output.say(f"  {name}{about(path)}")
        output.say("vinefab examples --out examples copies them")
        return 0
    missing = copy_examples(chosen, out, force=force)
    there = len(chosen) - len(missing)
    output.say(
        f"wrote {len(missing)} {'file' if len(missing) == 1 else 'files'} to {out}/"
        + (f", {there} unchanged" if there else "")
    )
    return 0


def about(path: Path) -> str:
    """Return a file's heading or first sentence, behind a colon; nothing of what is no text."""
    if path.suffix not in TEXTS:
        return ""
    lines = [line for line in read_text(path).splitlines() if not line.startswith("#!")]
    comment = " ".join(line[2:] for line in takewhile(lambda line: line[:2] == "# ", lines))
    first = next((words for line in lines if (words := line.strip("#\" '-"))), "")
    return f": {(comment or first).partition('. ')[0].rstrip('.')}"
