"""Drawings on sheets of paper: rendered by another program, measured, and put together again."""

import re
from functools import cache

import numpy as np
import pypdfium2
import pytest
import shapely

from tests.fabrication.conftest import fan, plan
from vinefab.core.errors import UnknownNameError
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec
from vinefab.fabrication.formats.pdf_format import pdf_bytes
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.model.job import Job, Operation
from vinefab.model.laser import read_profile
from vinefab.pages.panel import Ink, page_of_paper
from vinefab.pages.paper_tiles import PaperGrid, paper_sheets
from vinefab.pages.true_scale import true_scale

PX_PER_MM = 10.0
INSET_MM = 5.0  # from the dashed window to the crosses


@cache
def job() -> Job:
    profile = read_profile("impulse_sealer_300__stretchlon_800")
    tree = plan((40.0, 20.0), levels=[fan(3, 130.0, 150.0)], trunk=100.0, tail=110.0)
    return laser_job(tree, profile)


class Paper:
    """A printed sheet, rendered; what is measured in it is in mm from below left."""

    def __init__(self, page: pypdfium2.PdfPage) -> None:
        self.words = page.get_textpage().get_text_bounded()
        scale = PX_PER_MM * 25.4 / 72.0
        pixels = page.render(scale=scale).to_numpy()[::-1, :, :3].astype(float)
        # Pixels are whole: what their sides measure is told by the page.
        self.per_mm = np.array(pixels.shape[1::-1]) / (np.array(page.get_size()) / 72.0 * 25.4)
        blue, green, red = np.moveaxis(pixels, -1, 0)
        self.dark = 255.0 - pixels.mean(axis=-1)
        self.red = (red > 150.0) & (green < 120.0) & (blue < 120.0)

    def part(self, box_mm):
        x0, y0, x1, y1 = (round(side * self.per_mm[at % 2]) for at, side in enumerate(box_mm))
        return self.dark[y0:y1, x0:x1], np.array([x0, y0])

    def middle(self, box_mm):
        """Return the middle of the upright and of the level line in a box."""
        dark, low = self.part(box_mm)
        found = []
        for axis in (0, 1):
            ink = dark.sum(axis=axis)
            ink = np.where(ink > 0.6 * ink.max(), ink, 0.0)
            found.append((ink * (np.arange(len(ink)) + 0.5)).sum() / ink.sum())
        return (low + found) / self.per_mm

    def ruler_mm(self):
        """Return the distance between the outermost of the long ticks of the ruler."""
        dark, _ = self.part((5.0, 13.0, 130.0, 14.8))  # above its line, and above short ticks
        ink = dark.sum(axis=0)
        ticks = np.flatnonzero(ink > 0.5 * ink[: 60 * int(PX_PER_MM)].max())
        ends = []
        for at in (ticks[0], ticks[ticks < 112 * PX_PER_MM][-1]):
            near = np.arange(at - 3, at + 4)
            ends.append((ink[near] * (near + 0.5)).sum() / ink[near].sum())
        return (ends[1] - ends[0]) / self.per_mm[0]

    def name(self):
        found = re.search(r"row (\d+), column (\d+): sheet (\d+) of (\d+)", self.words)
        return tuple(map(int, found.groups()))


@cache
def printed(paper: str) -> list[Paper]:
    spec = LaserFileSpec(job=job())
    return [Paper(page) for page in pypdfium2.PdfDocument(pdf_bytes(spec, paper))][1:]


def crosses(sheet: Paper) -> dict[tuple[int, int], np.ndarray]:
    """Return the middles of a sheet's four crosses, by their place in the grid of crosses."""
    row, column, *_ = sheet.name()
    wide, high = np.array(sheet.dark.shape)[::-1] / sheet.per_mm
    found = {}
    for across, x in ((0, 10.0 + INSET_MM), (1, wide - 10.0 - INSET_MM)):
        for down, y in ((1, 19.0 + INSET_MM), (0, high - 16.0 - INSET_MM)):
            # Its arms on the side away from its name.
            box = x - 4.3, y - 4.3, x + 0.6, y + 0.6
            found[row + down, column + across] = sheet.middle(box)
    return found


@pytest.mark.parametrize("paper", ["a4", "letter"])
def test_ruler_and_crosses_measure_what_they_say_to_a_thousandth(paper: str) -> None:
    sheets = printed(paper)
    assert len(sheets) > 3
    pitches = []
    for sheet in sheets:
        assert sheet.ruler_mm() == pytest.approx(100.0, rel=1e-3)
        at = crosses(sheet)
        (row, column), *_ = sorted(at)
        across = at[row, column + 1] - at[row, column]
        up = at[row, column] - at[row + 1, column]
        pitches.append([across[0], up[1]])
        assert abs(across[1]) < 0.05
        assert abs(up[0]) < 0.05
    wide, high = np.array(sheets[0].dark.shape)[::-1] / sheets[0].per_mm
    # Paper less its edges, the strips for words and ruler, and the overlap.
    expected = wide - 2.0 * 10.0 - 10.0, high - 2.0 * 10.0 - 15.0 - 10.0
    assert np.array(pitches) == pytest.approx(np.tile(expected, (len(sheets), 1)), rel=1e-3)


@pytest.mark.parametrize("paper", ["a4", "letter"])
def test_sheets_put_together_by_their_crosses_are_the_outline(paper: str) -> None:
    sheets = {sheet.name()[:2]: sheet for sheet in printed(paper)}
    assert [sheet.name()[2:] for sheet in sheets.values()] == [
        (number, len(sheets)) for number in range(1, len(sheets) + 1)
    ]
    marks = {tile: crosses(sheet) for tile, sheet in sheets.items()}
    first, *left = sheets
    shift = {first: np.zeros(2)}
    while left:
        for tile in left:
            known = [(other, set(marks[tile]) & set(marks[other])) for other in shift]
            other, shared = max(known, key=lambda pair: len(pair[1]))
            if len(shared) == 2:  # a neighbour, edge to edge
                away = [marks[other][one] - marks[tile][one] for one in shared]
                assert np.abs(away[0] - away[1]).max() < 0.1
                shift[tile] = shift[other] + np.mean(away, axis=0)
                left.remove(tile)
                break
        else:
            pytest.fail("a sheet has no neighbour")
    ink = []
    for tile, sheet in sheets.items():
        y, x = np.nonzero(sheet.red)
        ink.append((np.column_stack([x, y]) + 0.5) / sheet.per_mm + shift[tile])
    cloud = np.concatenate(ink)
    (cut,) = job().along(Operation.CUT)
    outline = cut.contour.flattened_mm(0.005)
    # Where the whole lies is free: box on box.
    cloud += outline.min(axis=0) - cloud.min(axis=0)
    cloud += (outline.max(axis=0) - cloud.max(axis=0)) / 2.0
    ring = shapely.LinearRing(outline)
    shapely.prepare(ring)
    assert shapely.distance(ring, shapely.points(cloud)).max() < 0.2
    places = shapely.get_coordinates(shapely.segmentize(ring, 0.5))
    tree = shapely.STRtree(shapely.points(cloud))
    near, _ = tree.query(shapely.points(places), predicate="dwithin", distance=0.2)
    assert len(set(near.tolist())) == len(places)


def test_sheets_of_a_sparse_drawing_are_left_out_while_the_others_hang_together() -> None:
    panel = true_scale((0.0, 0.0, 800.0, 800.0))
    panel.line([(10.0, 10.0), (790.0, 10.0), (790.0, 790.0)], Ink(line="#000000"))
    corner = page_of_paper(panel)
    grid = PaperGrid.over((0.0, 0.0, 800.0, 800.0), "a4")
    used = grid.used(corner)
    assert len(used) == grid.rows + grid.columns - 1
    apart = true_scale((0.0, 0.0, 800.0, 800.0))
    apart.line([(10.0, 10.0), (20.0, 10.0)], Ink(line="#000000"))
    apart.line([(780.0, 790.0), (790.0, 790.0)], Ink(line="#000000"))
    assert grid.used(page_of_paper(apart)) == grid.tiles


def test_an_unknown_paper_is_told() -> None:
    drawing = page_of_paper(true_scale((0.0, 0.0, 10.0, 10.0)))
    with pytest.raises(UnknownNameError, match="no paper is called 'a5'; there are: a4, letter"):
        paper_sheets(drawing, (0.0, 0.0, 10.0, 10.0), "a5", "a title")
