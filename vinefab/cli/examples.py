"""``vinefab examples``: run files and scripts that ship with vinefab."""

from itertools import takewhile
from pathlib import Path
from typing import Annotated

import typer

from vinefab.cli.common_options import CommandOutput, Force, Quiet
from vinefab.core.atomic import ensure_writable, write_bytes
from vinefab.core.errors import UnknownNameError
from vinefab.model.files.shipped import read_text, shipped_root

FOLDER = "examples"
KINDS_SHOWN = (".toml", ".py", ".sbatch", ".ipynb", ".md", ".dxf", ".jpg", ".png", ".gpkg", ".yaml")
PICTURES = "pictures"
"""A folder of what the README shows; it is not copied."""

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
    known = shipped_examples()
    chosen = _chosen(names or [], known)
    if out is None:
        for name in chosen:
            output.say(f"  {name}{about(known[name])}")
        output.say("vinefab examples --out examples copies them")
        return 0
    missing = [name for name in chosen if not _is_there(out / name, known[name])]
    for name in missing:
        ensure_writable(out / name, force=force)
    for name in missing:
        write_bytes(out / name, known[name].read_bytes(), force=force)
    there = len(chosen) - len(missing)
    output.say(
        f"wrote {len(missing)} {'file' if len(missing) == 1 else 'files'} to {out}/"
        + (f", {there} unchanged" if there else "")
    )
    return 0


def shipped_examples() -> dict[str, Path]:
    """Return the shipped examples by their path below the folder of examples."""
    root = shipped_root() / FOLDER
    found = sorted(path for path in root.rglob("*") if path.suffix in KINDS_SHOWN)
    shown = (path for path in found if path.parent.name != PICTURES)
    return {path.relative_to(root).as_posix(): path for path in shown}


def about(path: Path) -> str:
    """Return a file's heading or first sentence, behind a colon; nothing of what is no text."""
    if path.suffix not in TEXTS:
        return ""
    lines = [line for line in read_text(path).splitlines() if not line.startswith("#!")]
    comment = " ".join(line[2:] for line in takewhile(lambda line: line[:2] == "# ", lines))
    first = next((words for line in lines if (words := line.strip("#\" '-"))), "")
    return f": {(comment or first).partition('. ')[0].rstrip('.')}"


def _is_there(path: Path, shipped: Path) -> bool:
    """Tell whether a copy lies there that nobody has changed."""
    return path.is_file() and path.read_bytes() == shipped.read_bytes()


def _chosen(names: list[str], known: dict[str, Path]) -> list[str]:
    chosen = []
    for name in names:
        fits = [place for place in known if name in (place, Path(place).stem, Path(place).name)]
        if not fits:
            raise UnknownNameError("example", name, known)
        chosen += fits
    return chosen or list(known)
