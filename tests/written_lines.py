"""What pages and helps tell a user to type: command lines and Python, in the order of the page."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from vinefab.app.verbs import VERBS
from vinefab.cli.commands import Command
from vinefab.maps.generators.environments import ENVIRONMENTS

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    ROOT / "README.md",
    *sorted(
        path
        for path in (ROOT / "docs").rglob("*.md")
        # Pages of verbs show the examples of the helps, which are typed in their order.
        if not {"_build", "verbs"} & set(path.parts)
    ),
    *sorted((ROOT / "examples").rglob("*.md")),
]
"""Pages for users: what stands in their blocks is theirs to type."""

FENCE = re.compile(r"^( *)```([^\n]*)\n(.*?)^\1```$", re.S | re.M)

SET_UP = ("make", ".ci/run")
"""Beginnings of lines that set up a checkout from the network and run these tests."""

OUT_OF_REACH = re.compile(r"\b(?:needs|takes) [^:;]+")
"""How a remark says that a line needs what a computer may lack, or takes longer than a test may."""


@dataclass(frozen=True, slots=True)
class WrittenLine:
    """A command line, or a block of Python, and what is said about it."""

    page: Path
    text: str
    code: int = 0  # the exit code that the page says
    left_out: str = ""  # why no test types it
    python: bool = False


def written_on(page: Path) -> list[WrittenLine]:
    """Return what a page tells a user to type; `# exit code 1: why` beside a line says its end."""
    lines: list[WrittenLine] = []
    for _, language, block in FENCE.findall(page.read_text(encoding="utf-8")):
        if language == "sh":
            lines += _shell_lines(page, block)
        elif language == "python":
            first = block.partition("\n")[0]
            why = _out_of_reach(first) if first.startswith("#") else ""
            lines.append(WrittenLine(page, block, left_out=why, python=True))
    return lines


def _shell_lines(page: Path, block: str) -> Iterator[WrittenLine]:
    for line in block.replace("\\\n", " ").splitlines():
        text, _, remark = line.partition(" #")
        if not text.strip() or text.startswith("#"):
            continue
        said = re.search(r"exit code (\d+):", remark)
        why = "sets up a checkout" if text.startswith(SET_UP) else _out_of_reach(remark)
        yield WrittenLine(page, " ".join(text.split()), int(said[1]) if said else 0, why)


def _out_of_reach(remark: str) -> str:
    """Return what a remark says is needed or how long it takes; nothing where a test can do it."""
    found = OUT_OF_REACH.search(remark)
    return found[0].strip() if found else ""


def languages_of(page: Path) -> list[str]:
    """Return the languages of a page's blocks."""
    return [language for _, language, _ in FENCE.findall(page.read_text(encoding="utf-8"))]


def mentioned_on(page: Path) -> list[WrittenLine]:
    """Return the commands that a page's sentences name with all their words."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    found = re.findall(r"(?<!`)`(vinefab [a-z][^`\n]*)`(?!`)", text)
    return [
        WrittenLine(page, line) for line in found if "..." not in line and len(line.split()) > 2
    ]


def help_examples() -> list[WrittenLine]:
    """Return the examples of every command's help, in the order of `vinefab -h`."""
    names = [*VERBS]
    place = names.index("map import")
    names[place:place] = [f"map {name}" for name in ENVIRONMENTS]
    return [
        WrittenLine(Path(f"vinefab {name} --help"), line)
        for name in names
        for line in Command.named(name).examples()
    ]


BANNED = re.compile(
    r"(?<!-)\b(?:beside(?!\n)|whoever|nobody|(?<!there )is no(?! longer)|of its own|in words"
    r"|goes on|by heart|at hand"
    r"|(?:says?|shows?|knows?|tells?|reads?|yields?|breaks|keeps) what"
    r"|(?:of|with|by|from|for|and|than) what)\b",
    re.IGNORECASE,
)
"""Turns of speech to avoid, the last ones "what ..." clauses as objects.

``beside`` at the end of a line is the parameter of that name.
"""
