"""SVG text as plain nodes with line numbers; entities that expand without end are refused."""

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from vinefab.core.errors import UnreadableFileError
from vinefab.files.shipped import read_bytes

_LARGEST_BYTES = 256 << 20
_DEEPEST = 256
_LONGEST_ENTITY = 500


@dataclass(slots=True)
class Node:
    """An element.

    Parameters
    ----------
    tag
        Its name without namespace.
    attributes
        By name without namespace.
    line
        Where it begins.
    children
        In order.
    text
        Characters directly in it.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    children: list["Node"] = field(default_factory=list)
    text: str = ""

    @property
    def where(self) -> str:
        """What messages call it."""
        name = self.attributes.get("id")
        return f"{self.tag}{f' {name!r}' if name else ''} (line {self.line})"


def read_nodes(path: Path) -> Node:
    """Return the root of an SVG file.

    Raises
    ------
    UnreadableFileError
        If it cannot be read, is not well formed, nests deeper than 256, declares entities that
        are long, nested or outside of the file, or is not SVG.
    """
    data = read_bytes(path, _LARGEST_BYTES)
    if not data.strip():
        raise UnreadableFileError(path, "is empty")
    builder = _Builder(path)
    parser = expat.ParserCreate(namespace_separator="}")
    parser.buffer_text = True
    builder.parser = parser
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.words
    parser.EntityDeclHandler = builder.entity
    try:
        parser.Parse(data, True)  # noqa: FBT003  expat's way to say that this is all
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise UnreadableFileError(path, f"is not SVG: {error}") from error
    if builder.root is None or builder.root.tag != "svg":
        raise UnreadableFileError(path, "is not SVG: its root is not <svg>")
    return builder.root


class _Builder:
    """Collects nodes from a parser's calls."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parser: expat.XMLParserType | None = None
        self.root: Node | None = None
        self.open: list[Node] = []

    @property
    def line(self) -> int:
        return self.parser.CurrentLineNumber if self.parser is not None else 0

    def start(self, name: str, attributes: dict[str, str]) -> None:
        if len(self.open) >= _DEEPEST:
            raise UnreadableFileError(
                self.path, f"elements more than {_DEEPEST} deep (line {self.line})"
            )
        plain: dict[str, str] = {}
        for key, value in attributes.items():
            # An attribute without namespace counts before one of the same name with.
            if "}" not in key or _plain(key) not in attributes:
                plain[_plain(key)] = value
        node = Node(_plain(name), plain, self.line)
        if self.open:
            self.open[-1].children.append(node)
        else:
            self.root = node
        self.open.append(node)

    def end(self, name: str) -> None:  # noqa: ARG002  expat passes it
        self.open.pop()

    def words(self, text: str) -> None:
        if self.open and self.open[-1].tag == "style":
            self.open[-1].text += text

    def entity(
        self,
        name: str,
        is_parameter: int,  # noqa: ARG002  expat passes it
        value: str | None,
        *outside: str | None,  # noqa: ARG002  expat passes them
    ) -> None:
        if value is None or "&" in value or "%" in value or len(value) > _LONGEST_ENTITY:
            raise UnreadableFileError(
                self.path, f"declares the entity {name!r}, which is long, nested or elsewhere"
            )


def _plain(name: str) -> str:
    return name.rpartition("}")[2]
