"""Corner markers as made: tiles from their STL, paper from the SVG, engraving from the DXF.

An independent reader, OpenCV's ArUco detector, looks at what is in the files.
"""

import io
import json
import shutil
import subprocess

import numpy as np
import pytest
import shapely
from PIL import Image, ImageDraw
from shapely import Polygon, box

from vinefab.core.errors import BadInputError
from vinefab.fabrication.formats.dxf_format import read_dxf
from vinefab.model.job import Operation
from vinefab.pages.panel import Shape, Words
from vinefab.rig.build import build_board
from vinefab.rig.fixtures import Fixtures, marker_gap_mm
from vinefab.rig.make import RigRequest, make_rig, plan_sheet
from vinefab.rig.part import RigOptions
from vinefab.rig.part_files import read_stl

cv2 = pytest.importorskip("cv2")

WALLS = (box(40, 60, 80, 100), box(110, 80, 150, 120))
BARE = RigRequest(pictures=False)


def found_in(pixels):
    """Return the corners of the markers in a picture by number, shape (4, 2), in pixels."""
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    corners, numbers, _ = cv2.aruco.ArucoDetector(words, settings).detectMarkers(pixels)
    numbers = [] if numbers is None else numbers.ravel().tolist()
    assert len(set(numbers)) == len(numbers)
    return {number: found[0] for number, found in zip(numbers, corners, strict=True)}


class Paper:
    """A picture of polygons in map coordinates, on a grey table."""

    def __init__(self, low, high, mm_per_pixel):
        self.low, self.top, self.mm = np.array(low), high[1], mm_per_pixel
        size = np.ceil((np.array(high) - low) / mm_per_pixel).astype(int)
        self.image = Image.new("L", tuple(size.tolist()), 128)
        self.draw = ImageDraw.Draw(self.image)

    def fill(self, points_mm, shade):
        """Fill a polygon; a pixel's index is its middle."""
        x = (points_mm[:, 0] - self.low[0]) / self.mm - 0.5
        y = (self.top - points_mm[:, 1]) / self.mm - 0.5
        self.draw.polygon(list(zip(x.tolist(), y.tolist(), strict=True)), fill=shade)

    def markers(self):
        return {
            number: np.c_[
                self.low[0] + (corners[:, 0] + 0.5) * self.mm,
                self.top - (corners[:, 1] + 0.5) * self.mm,
            ]
            for number, corners in found_in(np.array(self.image)).items()
        }


def seen_from_above(made, mm_per_pixel):
    """Return rig.json, the markers seen on each tile, white below the change of colour, and tiles.

    Each tile is drawn from the triangles of its STL file, where rig.json puts it.
    """
    content, found, tiles = json.loads(made.files["rig.json"]), {}, []
    for part in content["extras"]:
        if not part["name"].startswith("marker_"):
            continue
        mesh, to_map = read_stl(made.files[part["file"]]), np.array(part["transform_to_map"])
        points = mesh.vertices_mm @ to_map[:3, :3].T + to_map[:3, 3]
        flat, high = points[mesh.faces], mesh.vertices_mm[mesh.faces][:, :, 2].mean(axis=1)
        normal = np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
        low, top = points[:, :2].min(axis=0) - 5, points[:, :2].max(axis=0) + 5
        paper = Paper(low, top, mm_per_pixel)
        for index in np.argsort(high):  # upright faces are edges in the picture
            if normal[index, 2] > 1e-9:
                black = high[index] > part["colour_change_mm"] + 0.01
                paper.fill(flat[index, :, :2], 0 if black else 255)
        found |= paper.markers()
        tiles.append(points)
    return content, found, tiles


@pytest.mark.parametrize("scale", [1.0, 0.6])
def test_printed_tiles_are_found_where_rig_json_says(make_map, make_printer, scale):
    made = make_rig(make_map(*WALLS), make_printer(), RigOptions(style="plate", scale=scale), BARE)
    content, found, tiles = seen_from_above(made, 0.04 / scale)
    assert sorted(found) == [0, 1, 2, 3]
    for marker in content["markers"]:
        away_mm = np.abs(found[marker["number"]] - marker["corners_mm"]) * scale
        assert away_mm.max() < 0.06
        assert marker["side_printed_mm"] == 30.0
    for points, marker in zip(tiles, content["markers"], strict=True):
        # The marker's face is the tile's top, level with the floor.
        assert points[:, 2].max() == pytest.approx(marker["z_mm"], abs=1e-4) == 0.0


def test_tiles_lie_against_the_rig_and_print_on_a_bed_of_their_own(make_map, make_printer):
    made = make_rig(make_map(*WALLS), make_printer(), RigOptions(style="plate"), BARE)
    content = json.loads(made.files["rig.json"])
    tiles = [part for part in content["extras"] if part["name"].startswith("marker_")]
    beds = {part["bed"] for part in tiles}
    (bed,) = [bed for bed in content["beds"] if bed["file"] in beds]
    assert sorted(bed["parts"]) == [part["name"] for part in tiles]
    assert {part["colour_change_mm"] for part in tiles} == {2.4}
    assert any("change to black at 2.40 mm" in note for note in made.rig.notes)
    for part in made.rig.extras[2:6]:
        points = part.vertices_mm @ part.to_map[:3, :3].T + part.to_map[:3, 3]
        triangles = shapely.polygons(points[part.faces][:, :, :2])
        tile = shapely.union_all(triangles[shapely.area(triangles) > 0.0])
        assert tile.intersection(made.rig.plate).area < 1e-3
        # 25 mm along each side of the corner, less the relief at the corner itself.
        touching = tile.buffer(0.01).intersection(made.rig.plate.exterior).length
        assert touching == pytest.approx(48.0, abs=0.3)


def test_a_rig_without_corners_says_where_its_tiles_go(make_map, make_printer):
    round_hall = shapely.Point(100, 95).buffer(75)
    made = make_rig(
        make_map(*WALLS, bounds=round_hall), make_printer(), RigOptions(style="plate"), BARE
    )
    assert any("markers 0, 1, 2, 3: the rig has no corner there" in n for n in made.rig.notes)


def test_markers_stand_clear_of_a_high_border(make_map, make_printer):
    low, high = RigOptions(height_mm=5.0), RigOptions(style="plate", height_mm=60.0, border_mm=6.0)
    assert marker_gap_mm(low) == 12.0
    assert marker_gap_mm(high) == 36.0
    made = make_rig(make_map(*WALLS), make_printer(), high, BARE)
    corners = json.loads(made.files["rig.json"])["markers"][2]["corners_mm"]
    assert corners[3] == [190 + 36, 170 + 36]


def rendered(drawing, folder, dpi):
    """Return an SVG drawing as a picture in grey, by rsvg-convert."""
    (folder / "drawing.svg").write_bytes(drawing)
    command = ["rsvg-convert", "-d", f"{dpi}", "-p", f"{dpi}", "-b", "white", "-f", "png"]
    made = subprocess.run([*command, str(folder / "drawing.svg")], check=True, capture_output=True)
    return np.array(Image.open(io.BytesIO(made.stdout)).convert("L"))


@pytest.mark.skipif(not shutil.which("rsvg-convert"), reason="no rsvg-convert")
def test_the_plan_shows_the_markers_where_rig_json_says(make_map, make_printer, tmp_path):
    options = RigOptions(style="plate", scale=0.8)
    made = make_rig(make_map(*WALLS), make_printer(), options, BARE)
    found = found_in(rendered(made.files["plan.svg"], tmp_path, 200))
    assert sorted(found) == [0, 1, 2, 3]
    markers = json.loads(made.files["rig.json"])["markers"]
    seen = np.concatenate([found[number] for number in range(4)]) / 200 * 25.4 * (1, -1)
    meant = 0.8 * np.concatenate([marker["corners_mm"] for marker in markers])
    away = (seen - seen.mean(axis=0)) - (meant - meant.mean(axis=0))
    assert np.abs(away).max() < 0.1


@pytest.mark.skipif(not shutil.which("rsvg-convert"), reason="no rsvg-convert")
def test_paper_markers_have_their_true_size(make_map, make_printer, tmp_path):
    options = RigOptions(style="plate", markers="paper", marker_mm=36.0)
    made = make_rig(make_map(*WALLS), make_printer(), options, BARE)
    pixels = rendered(made.files["markers.svg"], tmp_path, 300)
    assert np.array(pixels.shape) / 300 * 25.4 == pytest.approx((297, 210), abs=0.2)
    found = found_in(pixels)
    assert sorted(found) == [0, 1, 2, 3]
    for corners in found.values():
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1)
        assert sides / 300 * 25.4 == pytest.approx(36.0, abs=0.1)


def test_paper_tiles_have_a_recess_level_with_the_floor(make_map, make_printer):
    made = make_rig(
        make_map(*WALLS), make_printer(), RigOptions(style="plate", markers="paper"), BARE
    )
    marker = json.loads(made.files["rig.json"])["markers"][0]
    (part,) = [part for part in made.rig.extras if part.name == "marker_0"]
    points = part.vertices_mm @ part.to_map[:3, :3].T + part.to_map[:3, 3]
    levels = np.unique(points[:, 2].round(4))
    assert levels == pytest.approx([-3.0, -2.6, 0.0, 0.4])
    floor = points[np.abs(points[:, 2] - marker["z_mm"]) < 1e-4][:, :2]
    assert Polygon(shapely.convex_hull(shapely.MultiPoint(floor))).contains(
        Polygon(marker["corners_mm"])
    )
    assert part.colour_change_mm == 0.0


def test_the_board_carries_engraved_markers(make_map, make_printer):
    options = RigOptions(style="board")
    made = make_rig(make_map(*WALLS), make_printer(), options, BARE)
    content = json.loads(made.files["rig.json"])
    assert not [part for part in content["extras"] if part["name"].startswith("marker_")]
    drawing = read_dxf(made.files["board_01.dxf"].decode())
    rings = [path.contour for path in drawing.paths if path.layer == Operation.CUT.layer]
    outline = max(
        (ring for ring in rings if not ring.arc_count), key=lambda ring: len(ring.points_mm)
    )
    # The board's lower left corner is that of the pad of marker 0: its quiet zone and the kerf.
    corner = outline.points_mm.min(axis=0) + 0.5 * options.kerf_mm + 5.0
    first = np.array(content["markers"][0]["corners_mm"]).min(axis=0)
    paper = Paper(first - 10, np.array(content["markers"][2]["corners_mm"]).max(axis=0) + 10, 0.1)
    paper.image.paste(255, (0, 0, *paper.image.size))
    for path in drawing.paths:
        points = path.contour.points_mm
        if path.layer == Operation.MARK.layer and len(points) == 2 and points[0, 1] == points[1, 1]:
            burnt = shapely.LineString(points - corner + first).buffer(0.5 * options.kerf_mm)
            paper.fill(shapely.get_coordinates(burnt), 0)
    found = paper.markers()
    assert sorted(found) == [0, 1, 2, 3]
    for marker in content["markers"]:
        assert marker["z_mm"] == 0.0
        assert np.abs(found[marker["number"]] - marker["corners_mm"]).max() < 0.15


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"markers": "gold"}, "markers is 'gold'; allowed: 'print', 'paper', 'engrave' or 'none'"),
        ({"markers": "engrave"}, "print, paper or none for style plate"),
        ({"marker_mm": 5.0}, "marker_mm is 5"),
    ],
)
def test_markers_that_cannot_be_made_are_refused(options, words):
    with pytest.raises(BadInputError, match=words):
        RigOptions(**({"style": "plate"} | options))


def test_the_plan_of_a_board_numbers_its_pieces_and_their_pegs(make_map, make_printer):
    options = RigOptions(style="board")
    rig, pieces = build_board(make_map(*WALLS), make_printer(), options)
    (panel,) = plan_sheet(rig, make_map(*WALLS), Fixtures(), pieces).panels
    texts = {one.text: one.at for one in panel.primitives if isinstance(one, Words)}
    assert {str(piece.number) for piece in pieces} < set(texts)
    for piece in pieces:
        at = shapely.Point(texts[str(piece.number)])
        assert piece.outline.contains(at)
        assert not any(peg.outline.intersects(at) for peg in piece.pegs)
    lines = [line for one in panel.primitives if isinstance(one, Shape) for line in one.chains]
    ends = [tuple(line.mean(axis=0).round(3)) for line in lines if len(line) == 2]
    pegs = [(peg.x_mm, peg.y_mm) for piece in pieces for peg in piece.pegs]
    assert len(pegs) > 4
    assert all(ends.count(peg) == 2 for peg in pegs)


def test_without_markers_there_is_none(make_map, make_printer):
    options = RigOptions(style="plate", markers="none", base_start=0)
    made = make_rig(make_map(*WALLS), make_printer(), options, BARE)
    assert json.loads(made.files["rig.json"])["markers"] == []
    assert len(made.rig.extras) == 2
    assert "markers.svg" not in made.files
