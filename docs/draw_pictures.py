"""Draw the pictures of the documentation anew: design rules, words, designs, environments.

Run it as ``python docs/draw_pictures.py`` in a checkout. What it draws is simulated or computed,
and the same on every machine.
"""

from pathlib import Path

from draw_rules import rule_pictures
from draw_words import word_pictures
from rule_sketch import WIDTH_PX

import vinefab as vf
from vinefab.pages import plan_document

PICTURES = Path(__file__).resolve().parent / "pictures"

HOMES = {"cave_explorer": "cave", "cave_explorer_pieces": "cave", "six_branch_anchor": "cave"}
"""Environments of shipped designs; of all others the Grid."""


def main() -> None:
    for name, text in {**rule_pictures(), **word_pictures(), **gallery_pictures()}.items():
        path = PICTURES / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(f"{path.relative_to(PICTURES)}: {len(text) / 1000:.0f} kB")


def gallery_pictures() -> dict[str, str]:
    """Return every shipped design on a map and flat, and a map of every environment."""
    plan_document.LONGEST_PX = WIDTH_PX
    found = {}
    for name in vf.designs():
        design = vf.Design.read(name)
        world = vf.maps.generate(HOMES.get(name, "grid"), seed=3)
        found[f"gallery/{name}.svg"] = str(design.grow(world)._repr_svg_())
        found[f"gallery/{name}_flat.svg"] = str(design._repr_svg_())
    for name in ("grid", "cave", "rubble", "corridors", "pegs"):
        found[f"gallery/{name}.svg"] = str(vf.maps.generate(name, seed=3)._repr_svg_())
    return found


if __name__ == "__main__":
    main()
