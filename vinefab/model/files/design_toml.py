"""Design files: TOML, schema ``vinefab/design-1``."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import tomli_w

from vinefab.core.errors import located
from vinefab.core.jsontext import GENERATOR
from vinefab.core.table import validated
from vinefab.core.validation import check_plain
from vinefab.model.design import Design
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import read_toml, table_content


def read_design(name_or_path: str | PathLike[str]) -> Design:
    """Return the design in a file, or a shipped one by name.

    Lengths in ``[trunk]`` and ``[[level]]`` are multiplied by ``scale_mm_per_unit``; everything
    in ``[build]`` is in millimetres already.
    """
    path = locate("design", name_or_path)
    return design_of(read_toml(path), path).changed(folder=path.parent)


def design_of(content: Mapping[str, Any], source: str | Path) -> Design:
    """Return the design in the content of a design file.

    Parameters
    ----------
    content
        Tables and values as `design_content` gives them.
    source
        What messages call the content.

    Raises
    ------
    BadInputError
        If a value cannot be used; its key is dotted, ``level.1.length``.
    """
    design = validated(Design, content, source)
    with located(source):
        check_plain({"origin": dict(design.origin)})
    return design


def design_content(design: Design) -> dict[str, Any]:
    """Return a design as tables and values of a design file; lengths are in millimetres."""
    return table_content(design)


def design_text(design: Design) -> str:
    """Return a design as the text of a design file; reading it gives the same design."""
    content = table_content(design)
    if not design.build.taper:
        del content["build"]["taper"]
    head = {key: value for key, value in content.items() if not isinstance(value, dict | list)}
    blocks = [f"# {GENERATOR}\n{tomli_w.dumps(head)}"]
    for name, value in content.items():
        if isinstance(value, list):
            blocks += [f"[[{name}]]\n{tomli_w.dumps(table)}" for table in value]
        elif isinstance(value, dict) and value:
            blocks.append(tomli_w.dumps({name: value}))
    return "\n".join(blocks)
