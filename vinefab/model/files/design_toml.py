"""Design files: TOML, schema ``vinefab/design-1``."""

from typing import TYPE_CHECKING, Any

import tomli_w

from vinefab.core.jsontext import GENERATOR
from vinefab.model.files.toml import table_content

if TYPE_CHECKING:
    from vinefab.model.design import Design


def design_content(design: "Design") -> dict[str, Any]:
    """Return a design as tables and values of a design file; lengths are in millimetres."""
    return table_content(design)


def design_text(design: "Design") -> str:
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
