"""Draw the pictures of the documentation anew: design rules, words, designs, environments.

Run it as ``python docs/draw_pictures.py`` in a checkout. What it draws is simulated or computed,
and the same on every machine.
"""

from pathlib import Path

from draw_rules import rule_pictures
from draw_words import word_pictures
from rule_sketch import WIDTH_PX

import vinefab as vf
from vinefab.noun_pictures import svg_of

PICTURES = Path(__file__).resolve().parent / "pictures"

CAVERS = "cave_", "six_branch_anchor"
"""What names of shipped designs for Caves begin with; all others are drawn on a Grid."""


def main() -> None:
    for name, text in {**rule_pictures(), **word_pictures(), **gallery_pictures()}.items():
        path = PICTURES / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        print(f"{path.relative_to(PICTURES)}: {len(text) / 1000:.0f} kB")


def gallery_pictures() -> dict[str, str]:
    """Return shipped designs on a map and flat, and a map of every environment.

    Those of levels that free trees stand for now are left out.
    """
    longest_pt = 0.65 * WIDTH_PX  # with names and ticks as wide as the other pictures
    found = {}
    for name in (one for one in vf.designs() if not one.endswith("_levels")):
        design = vf.Design.read(name)
        world = vf.maps.generate("cave" if name.startswith(CAVERS) else "grid", seed=3)
        found[f"gallery/{name}.svg"] = str(svg_of(design.grow(world), longest_pt=longest_pt))
        found[f"gallery/{name}_flat.svg"] = str(svg_of(design, longest_pt=longest_pt))
    for name in ("grid", "cave", "rubble", "corridors", "pegs"):
        world = vf.maps.generate(name, seed=3)
        found[f"gallery/{name}.svg"] = str(svg_of(world, longest_pt=longest_pt))
    return found


if __name__ == "__main__":
    main()
