"""A page in a narrow window: captions are read whole, and narrow tables are not made wide."""

import pytest

from vinefab.core.view import Number, Rows, Section
from vinefab.pages.html import page

MEASURED = """() => [...document.querySelectorAll(".scroll")].map((box) => ({
  room: box.clientWidth,
  wide: box.scrollWidth,
  caption: box.querySelector("caption span").getBoundingClientRect().right
    - box.getBoundingClientRect().left,
}))"""


@pytest.mark.parametrize("width", [390, 1280])
def test_captions_fit_and_a_table_of_short_cells_does_not_scroll(browser, tmp_path, width):
    caption = "Walls that tips met, in their order, lengths in mm and in percent of the length seen"
    few = Rows(
        caption=caption,
        headings=("branch", "seen", "predicted", "same"),
        rows=((Number(0), "obstacle 0", "obstacle 0", "yes"),),
    )
    many = Rows(
        caption=caption, headings=tuple(12 * ["length mm"]), rows=(tuple(12 * [Number(181.2)]),)
    )
    path = tmp_path / "page.html"
    path.write_text(
        page("Seen", [few, Section(title="Rows", tables=(few, many))]), encoding="utf-8"
    )
    with browser.new_context(viewport={"width": width, "height": 844}) as context:
        shown = context.new_page()
        shown.goto(path.as_uri())
        boxes = shown.evaluate(MEASURED)
        assert shown.evaluate("document.documentElement.scrollWidth") == width
    assert len(boxes) == 3
    for box in boxes:
        assert box["caption"] <= box["room"] + 1
    assert [box["wide"] <= box["room"] + 1 for box in boxes[:2]] == [True, True]
