"""Texts of users as files and terminals take them: nothing in them is obeyed."""


def visible(text: str) -> str:
    """Return a text to print: what a terminal would obey (escapes, marks of direction) is shown."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else "\N{REPLACEMENT CHARACTER}"
        for letter in text
    )


def one_line(text: str) -> str:
    """Return a text without line breaks and control characters, which end a DXF or XML string."""
    printable = (letter if letter.isprintable() else " " for letter in text)
    return " ".join("".join(printable).split())


def agreeing(count: int, one: str, several: str) -> str:
    """Return the word that agrees with a count.

    >>> [f"{counted(n, 'wall')} {agreeing(n, 'was', 'were')} joined" for n in (1, 2)]
    ['1 wall was joined', '2 walls were joined']
    """
    return one if count == 1 else several


def counted(count: int, noun: str) -> str:
    """Return a count with its noun, which is regular.

    >>> [counted(n, noun) for n, noun in ((1, "branch"), (2, "branch"), (0, "wall"), (3, "entry"))]
    ['1 branch', '2 branches', '0 walls', '3 entries']
    """
    if count == 1:
        return f"1 {noun}"
    if noun.endswith(("s", "x", "z", "ch", "sh")):
        return f"{count} {noun}es"
    if noun.endswith("y") and noun[-2:-1] not in "aeiou":
        return f"{count} {noun[:-1]}ies"
    return f"{count} {noun}s"
