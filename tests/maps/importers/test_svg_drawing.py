import math

import numpy as np
import pytest
import shapely
import svgelements
from shapely import Polygon

from vinefab.core import bounded
from vinefab.core.errors import BadInputError, UnknownNameError, UnreadableFileError
from vinefab.maps.cleanup import assemble
from vinefab.maps.generators.grid import grid_map
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map
from vinefab.maps.importers.source_drawing import run_flat
from vinefab.maps.importers.svg_shapes import path_outlines
from vinefab.model.map import map_text

PAGE = 'xmlns="http://www.w3.org/2000/svg" width="200mm" height="100mm" viewBox="0 0 200 100"'
BOUNDS = '<rect width="200" height="100" fill="none" stroke="black"/>'
FINE = ImportOptions(simplify_mm=0.001)


@pytest.fixture
def drawn(tmp_path):
    """Return a function that imports SVG elements on a page of 200 x 100 mm with a frame."""

    def draw(body, options=FINE, page=PAGE, frame=BOUNDS):
        path = tmp_path / "plan.svg"
        path.write_text(body if page is None else f"<svg {page}>{frame}{body}</svg>")
        return import_map(path, options)

    return draw


SHAPES = {
    "rect": ('<rect x="10" y="20" width="30" height="5"/>', 150),
    "round rect": (
        '<rect x="10" y="20" width="30" height="20" rx="4"/>',
        600 - (4 - math.pi) * 16,
    ),
    "circle": ('<circle cx="50" cy="50" r="20"/>', 400 * math.pi),
    "ellipse": ('<ellipse cx="50" cy="50" rx="20" ry="5"/>', 100 * math.pi),
    "polygon": ('<polygon points="10,10 30,10,25 3e1 10+30"/>', 350),
    "closed polyline": (
        '<polyline points="10,10 30,10 30,30 10,10" fill="none" stroke="red"/>',
        200,
    ),
    "filled polyline": ('<polyline points="10,10 30,10 30,30"/>', 200),
    "relative path": ('<path d="m10 10h20v20H10z"/>', 400),
    "arcs": ('<path d="M40 50a10 10 0 0120 0 10 10 0 01-20 0z"/>', 100 * math.pi),
    "two subpaths": ('<path d="M10 10h30v30h-30z m10 10v10h10v-10z"/>', 800),
    "subpaths the same way round": ('<path d="M10 10h30v30h-30z m10 10h10v10h-10z"/>', 900),
    "even odd": ('<path fill-rule="evenodd" d="M9 9h30v30h-30z m10 10h10v10h-10z"/>', 800),
    "transforms": (
        '<g transform="translate(60 20) rotate(30)"><g transform="scale(2 3) skewX(20)">'
        '<rect width="5" height="4"/></g></g>',
        20 * 6,
    ),
    "matrix": ('<rect transform="matrix(0 1 -1 0 80 10)" width="20" height="10"/>', 200),
    "rotate about": (
        '<rect transform="rotate(90,50,50)" x="40" y="45" width="20" height="9"/>',
        180,
    ),
    "units": ('<rect x="1cm" y="1cm" width="1cm" height="1cm"/>', (10 * 96 / 25.4) ** 2),
    "use": (
        '<defs><rect id="r" width="5" height="4"/></defs><use href="#r" x="9" y="9"/>'
        '<use href="#r" transform="translate(50 50) scale(2)"/>',
        20 + 80,
    ),
    "symbol": (
        '<symbol id="s" viewBox="0 0 10 10"><rect width="10" height="10"/></symbol>'
        '<use href="#s" x="20" y="20" width="30" height="40"/>',
        900,
    ),
    "nested svg": (
        '<svg x="10" y="10" width="20" height="20" viewBox="0 0 100 100">'
        '<circle cx="50" cy="50" r="50"/></svg>',
        100 * math.pi,
    ),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_shapes(drawn, kind):
    body, area = SHAPES[kind]
    world = drawn(body)
    assert sum(p.area for p in world.obstacles) == pytest.approx(area, rel=1e-3)
    assert world.size_mm == (200, 100)


def test_up_is_up_and_the_page_is_the_frame(drawn):
    world = drawn('<rect x="10" y="20" width="30" height="5"/>')
    assert world.bounds.bounds == (0, 0, 200, 100)
    assert world.obstacles[0].bounds == pytest.approx((10, 75, 40, 80))


@pytest.mark.parametrize(
    ("page", "mm"),
    [
        ('width="20cm" height="10cm" viewBox="0 0 200 100"', 1.0),
        ('width="2in" height="1in" viewBox="0 0 200 100"', 0.254),
        ('viewBox="0 0 200 100" width="100%"', 25.4 / 96),
        ('width="200" height="100"', 25.4 / 96),
        ('width="200mm" viewBox="0 0 200 100"', 1.0),
    ],
)
def test_units(drawn, page, mm):
    world = drawn("", page=f'xmlns="http://www.w3.org/2000/svg" {page}')
    assert world.size_mm == pytest.approx((200 * mm, 100 * mm))
    scaled = drawn("", ImportOptions(scale_mm_per_unit=3.0), f'xmlns="..." {page}')
    assert scaled.size_mm == pytest.approx((600, 300))


PATHS = [
    "M 20,20 C 20,50 60,50 60,20 S 100,-10 100,20 Z",
    "M20 20Q40 60 60 20T100 20t-10 40z",
    "m20,60 a25,15 -30 1,1 50,-25 l0,30z M 80 80 A 10 5 45 0 0 90 90 L 90 80 z",
    "M30 30A1 1 0 0 1 50 30z",
    "M10-20.5.5e1-3L4,4+3-30Z",
    "M 10 10 L 20 10 20 20 10 20 z l 5 5 l 1 -1 l 0 4 z",
    "M20 20c0,30 40,30 40,0s40,-30 40,0h.5v-.5H80V10z",
]


@pytest.mark.parametrize("data", PATHS)
def test_path_data_as_another_reader_has_it(data):
    ours = [run_flat(tuple(run.pieces), 1e-4) for run in path_outlines(data)]
    theirs = []
    for run in svgelements.Path(data).as_subpaths():
        part = svgelements.Path(run)
        points = [part.point(t) for t in np.linspace(0.0, 1.0, 1500)]
        theirs.append(np.array([(point.x, point.y) for point in points]))
    assert len(ours) == len(theirs)
    for one, other in zip(ours, theirs, strict=True):
        rings = [shapely.LinearRing(points) for points in (one, other)]
        assert shapely.hausdorff_distance(*rings) < 0.2
        assert abs(Polygon(one).area - Polygon(other).area) < 0.05


def test_what_is_not_drawn_is_left_out_and_counted(drawn):
    body = (
        "<style>/* x */ .gone{display:none}</style>"
        '<g display="none"><rect width="9" height="9"/></g>'
        '<rect class="gone" x="5" y="5" width="9" height="9"/><text x="9" y="9">plan</text>'
        '<rect style="visibility:hidden" x="5" y="5" width="9" height="9"/>'
        '<defs><rect x="5" y="5" width="9" height="9"/></defs>'
        '<rect width="200" height="100" fill="white"/><circle cx="99" cy="50" r="9"/>'
    )
    world = drawn(body)
    assert len(world.obstacles) == 1
    assert world.facts["ignored"] == {
        "display:none": 2,
        "text": 1,
        "hidden": 1,
        "background of the page": 1,
    }


def test_the_paper_is_the_bounds_when_nothing_else_is(drawn):
    body = '<rect width="200" height="100" fill="white"/><circle cx="50" cy="50" r="9"/>'
    world = drawn(body, frame="")
    assert world.bounds.area == pytest.approx(20_000)
    assert len(world.obstacles) == 1


def test_points_between_pieces_are_no_repeats(drawn):
    world = drawn('<path d="M10 10h20v20h-20z"/>')
    assert "duplicate_points_removed" not in world.facts


def test_groups_are_chosen_by_id_or_label(drawn):
    name = 'xmlns:i="http://www.inkscape.org/namespaces/inkscape" i:label="Walls &amp; doors"'
    body = (
        f'<g {name} id="layer1"><rect x="5" y="5" width="90" height="90"/>'
        '<g id="in"><rect x="9" y="9" width="9" height="9"/></g></g>'
    )
    for layer in ("layer1", "Walls & doors"):
        world = drawn(body, ImportOptions(layers=(layer,)))
        assert world.size_mm == pytest.approx((90, 90))
        assert len(world.obstacles) == 1
    with pytest.raises(UnknownNameError, match=r"layer or group is called 'layer2'.*'layer1'"):
        drawn(body, ImportOptions(layers=("layer2",)))


def test_a_floor_plan_of_stroked_lines_becomes_walls(drawn):
    body = (
        '<g stroke="red"><path d="M5 5H195V95H5Z" fill="none"/>'
        '<line x1="80" y1="5" x2="80" y2="60"/></g>'
        '<rect x="120" y="40" width="10" height="10" fill="#888"/>'
    )
    world = drawn(body, ImportOptions(wall_mm=2.0), frame="")
    assert world.bounds.bounds == pytest.approx((4, 4, 196, 96))
    assert world.facts["bounds_are"] == "the outer face of a wall, a wall"
    assert world.free_space.area == pytest.approx(188 * 88 - 2 * 54 - 100)
    assert world.free_space.geom_type == "Polygon"


def test_a_wall_with_two_faces(drawn):
    body = '<path d="M5 5H195V95H5Z M10 10V90H190V10Z"/><circle cx="50" cy="50" r="9"/>'
    rooms = drawn(body, ImportOptions(bounds="wall"), frame="")
    assert rooms.free_space.area == pytest.approx(180 * 80 - 81 * math.pi, rel=1e-3)
    assert rooms.starts[0].pose.x_mm > 50


def test_a_plot_by_matplotlib_comes_back(tmp_path):
    figure_module = pytest.importorskip("matplotlib.figure")
    world = grid_map(6)
    figure = figure_module.Figure(figsize=(5, 5))
    axes = figure.add_axes((0.05, 0.05, 0.9, 0.9))
    axes.axis("off")
    for polygon in (world.bounds, *world.obstacles):
        axes.fill(*polygon.exterior.xy, facecolor="none", edgecolor="black")
    axes.set(xlim=(0, 500), ylim=(0, 500))
    path = tmp_path / "plot.svg"
    figure.savefig(path)
    # 500 mm are drawn over 0.9 of 360 points.
    again = import_map(path, ImportOptions(scale_mm_per_unit=500 / 324))
    corner = again.bounds.bounds[:2]
    moved = [shapely.affinity.translate(p, -corner[0], -corner[1]) for p in again.obstacles]
    assert len(moved) == len(world.obstacles)
    difference = shapely.union_all(moved) ^ shapely.union_all(world.obstacles)
    assert difference.area < 1e-3 * sum(p.area for p in world.obstacles)


REFUSED = {
    "no path": (
        '<path id="p" d="M 0 0 L 5 x"/>',
        r"path 'p' \(line 1\): d, character 7 is 'L 5 x'",
    ),
    "no move": ('<path d="L 5 5"/>', "path data such as M"),
    "no number": ('<circle r="wide"/>', r"circle \(line 1\): r is 'wide'"),
    "unit": ('<rect width="10furlong" height="9"/>', "width is '10furlong'"),
    "mask": ('<mask id="m"><circle r="9" fill="grey"/></mask><g mask="url(#m)"/>', "by degrees"),
    "clip": ('<rect width="9" height="9" clip-path="inset(2px)"/>', "clip-path 'inset.* not read"),
    "media": ("<style>@media (min-width: 9px) {rect {fill: none}}</style>", "@media .min-width"),
    "import": ("<style>@import url(walls.css);</style>", "@import .*plain SVG"),
    "animation": ('<rect width="9" height="9"><animateMotion/></rect>', "an animation moves"),
    "variable": ('<rect style="display:var(--a)" width="9" height="9"/>', "display: var"),
    "offset": ('<rect style="translate:9px" width="9" height="9"/>', "translate: 9px is not read"),
    "negative": ('<rect width="-10" height="9"/>', "width is -10.0; allowed: at least 0"),
    "odd": ('<polygon points="1 2 3"/>', "3 numbers"),
    "infinite": ('<circle r="1e999"/>', "r is '1e999'"),
    "huge": ('<circle r="1e11" fill="none" stroke="red"/>', "drawing is"),
    "transform": ('<rect transform="turn(3)" width="1" height="1"/>', "transform is"),
    "flat": ('<rect transform="scale(0)" width="1" height="1"/>', "not singular"),
    "missing": ('<use href="#nothing"/>', "href is '#nothing'"),
    "elsewhere": ('<use href="file:///etc/passwd#x"/>', "id of an element in the file"),
    "endless": ('<g id="a"><use href="#a"/></g>', "a use that contains itself"),
    "open": (
        '<path d="M20 20 L 90 90" fill="none" stroke="red"/>',
        r"from \(20, 20\) to \(90, 90\)",
    ),
    "outside": (
        '<circle cx="300" cy="50" r="5"/>',
        r"circle \(line 1\) at \(300, [\d.]+\).*outside",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_not_clear_is_refused_with_its_place(drawn, kind):
    body, message = REFUSED[kind]
    with pytest.raises(BadInputError, match=message) as caught:
        drawn(body)
    assert str(caught.value).count("plan.svg: ") == 1


BOMB = (
    '<!DOCTYPE svg [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    '<svg xmlns="http://www.w3.org/2000/svg"><text>&b;</text></svg>'
)
FILE = '<!DOCTYPE svg [<!ENTITY f SYSTEM "file:///etc/passwd">]><svg><text>&f;</text></svg>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("\0\1\2", "not SVG"),
        ("<svg><g></svg>", "mismatched tag"),
        ("<html/>", "root is not <svg>"),
        (BOMB, "entity 'b'"),
        (FILE, "entity 'f'"),
        ("<svg>" + "<g>" * 9999 + "</g>" * 9999 + "</svg>", "deep"),
    ],
)
def test_files_that_are_no_drawing(drawn, text, message):
    with pytest.raises(UnreadableFileError, match=message):
        drawn(text, page=None)


def test_uses_that_multiply_are_stopped(drawn, limits):
    limits.setattr(bounded, "_CPU_S", 1)
    levels = [
        f'<g id="g{k + 1}">{"".join(f"<use href={q}#g{k}{q}/>" for q in chr(34) * 10)}</g>'
        for k in range(8)
    ]
    body = f'<defs><rect id="g0" width="1" height="1"/>{"".join(levels)}</defs><use href="#g8"/>'
    with pytest.raises(UnreadableFileError, match="cannot be read within 1 s"):
        drawn(body)


def test_short_entities_are_what_drawing_programs_write(drawn):
    text = (
        '<!DOCTYPE svg [<!ENTITY ns "http://www.w3.org/2000/svg">]>'
        '<svg xmlns="&ns;" width="20mm" height="10mm" viewBox="0 0 20 10">'
        '<circle cx="9" cy="5" r="4"/></svg>'
    )
    assert drawn(text, page=None).size_mm == pytest.approx((8, 8), abs=1e-2)


def test_only_text_is_no_drawing(drawn):
    with pytest.raises(BadInputError, match=r"has no outlines: .*'text': 1"):
        drawn("<text>hello</text>", frame="")


def test_many_obstacles_give_the_same_map_as_few(drawn, monkeypatch):
    row = "".join(f'<rect x="{10 * k + 5.3}" y="20.7" width="5" height="5"/>' for k in range(18))
    few = drawn(row)
    monkeypatch.setattr(assemble, "_MANY_OBSTACLES", 0)
    assert map_text(drawn(row)) == map_text(few)


@pytest.mark.parametrize(
    ("head", "mm"),
    [
        ("<!-- Generator: Adobe Illustrator 24.0.1, SVG Export Plug-In -->", 25.4 / 72),
        ("<!-- made by hand -->", 25.4 / 96),
    ],
)
def test_pixels_are_those_of_the_program_that_wrote_them(drawn, head, mm):
    page = 'xmlns="http://www.w3.org/2000/svg" width="200px" height="100px" viewBox="0 0 200 100"'
    world = drawn(f"{head}<svg {page}>{BOUNDS}</svg>", page=None)
    assert world.size_mm == pytest.approx((200 * mm, 100 * mm))
    assert world.facts["unit_known_by"] == ("program" if mm > 0.3 else "guess")


@pytest.mark.parametrize(("version", "per_inch"), [("0.48.5 r10040", 90), ("1.2", 96)])
def test_pixels_of_an_old_inkscape_are_larger(drawn, version, per_inch):
    prefix = 'xmlns:i="x" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
    page = f'width="200" height="100" {prefix} inkscape:version="{version}"'
    assert drawn("", page=page).size_mm[0] == pytest.approx(200 * 25.4 / per_inch)


CARD = '<rect x="4" y="3" width="192" height="94" fill="white"/>'
ROOM = '<path d="M6 6H194V94H6Z" fill="none" stroke="red"/>'


def test_a_background_is_painted_first_covers_the_page_and_holds_the_rest(drawn):
    table = '<rect x="50" y="50" width="20" height="10"/>'
    world = drawn(CARD + ROOM + table, frame="")
    assert world.free_space.area == pytest.approx(188 * 88 - 200)
    assert world.facts["ignored"] == {"background of the page": 1}
    for body in (ROOM + table + CARD, CARD.replace("4", "30", 1) + table, CARD + table):
        assert "ignored" not in drawn(body, frame="").facts


def test_letters_by_use_are_text(drawn):
    glyph = '<defs><g id="glyph0-1"><path d="M0 0h6v-8h-6zM1 -1v-6h4v6z"/></g></defs>'
    world = drawn(f'{glyph}<g fill="#000"><use href="#glyph0-1" x="9" y="90"/></g>')
    assert world.facts["ignored"] == {"text": 1}
    assert not world.obstacles


def test_attributes_of_a_prefix_that_no_one_declares_are_passed_over(drawn):
    assert len(drawn('<path sodipodi:nodetypes="cc" d="M9 9h9v9z"/>').obstacles) == 1


def test_a_page_of_another_shape_than_its_box_is_stretched(drawn):
    page = 'width="400mm" height="100mm" viewBox="0 0 200 100" preserveAspectRatio="none"'
    world = drawn('<circle cx="100" cy="50" r="10"/>', page=page)
    assert world.size_mm == pytest.approx((400, 100))
    left, low, right, high = world.obstacles[0].bounds
    assert (right - left, high - low) == pytest.approx((40, 20), rel=1e-3)
