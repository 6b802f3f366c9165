"""The section on how to get the same report again."""

from collections.abc import Mapping

from vinefab.report.content import Section, Table


def repeat_section(command: str, inputs: Mapping[str, str], versions: Mapping[str, str]) -> Section:
    """Return the command, the inputs' fingerprints and the versions behind a report.

    Parameters
    ----------
    command
        What to type.
    inputs
        Fingerprint of each input's content, by name.
    versions
        Version of each program.
    """
    return Section(
        title="How to reproduce",
        paragraphs=(
            "The same command with the same inputs and versions gives the same file, byte for "
            "byte; results do not depend on the computer beyond rounding.",
        ),
        code=command,
        tables=(
            Table(
                caption="Fingerprints of what went in (SHA-256, shortened)",
                headings=("input", "fingerprint"),
                rows=tuple(inputs.items()),
            ),
            Table(
                caption="Versions",
                headings=("program", "version"),
                rows=tuple(versions.items()),
            ),
        ),
    )
