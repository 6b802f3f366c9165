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
