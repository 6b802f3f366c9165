"""Draw what the pages on maps, making, photos and the tutorials describe.

Run it as ``python docs/draw_pages.py`` in a checkout: the pages' commands are called in an empty
folder, and their pictures kept. Pictures of HTML pages are taken by the browser of `studio_film`.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright
from studio_film import CHROMIUM

import vinefab as vf
from vinefab.fabrication.formats.laser_drawing import package_spec
from vinefab.fabrication.formats.pdf_format import pattern_page
from vinefab.fabrication.job.bar_strokes import bar_strokes
from vinefab.fabrication.package.prepare import Prepared, prepare
from vinefab.fabrication.package.sheet_pictures import job_plan
from vinefab.model.laser import read_profile
from vinefab.noun_pictures import svg_of
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import Layer, Page, Words
from vinefab.pages.paper_tiles import paper_sheets
from vinefab.pages.true_scale import PT_PER_MM

PAGES = Path(__file__).resolve().parent / "pictures" / "pages"
SPRIG = "examples/arena/sprig.toml"
PHOTOS = {1: (152, 132, 2), 3: (152, 122, 8)}
"""Poses of the photos that are shown, as `docs/tutorials/rig_and_reality.md` types them."""


def main() -> None:
    PAGES.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name, data in (*making(), *maps(), *reality()):
            (PAGES / name).write_bytes(data)
            print(f"{name}: {len(data) / 1000:.0f} kB")


def making() -> Iterator[tuple[str, bytes]]:
    """Yield a first robot, findings, sheets, pieces, folds, coupons and a report."""
    vf.new("map", "table.geojson")
    table, tree = vf.Map.read("table.geojson"), vf.Design.read("three_level_tree")
    yield "grown.svg", svg_bytes(tree.grow(table))
    narrow = tree.with_level(2, angle_deg=8.0).with_level(3, angle_deg=8.0, name="narrow")
    vf.check(narrow, out="findings.svg")
    yield "findings.svg", Path("findings.svg").read_bytes()
    for name, film in {"sheet": "stretchlon_200", "sealer": "stretchlon_800"}.items():
        job = prepare(tree, read_profile(f"co2_60w__{film}")).job
        yield f"{name}.svg", page_svg(job_plan(job))
    by_hand = prepare(tree, read_profile("impulse_sealer_300__stretchlon_800"))
    yield "pattern.svg", page_svg(pattern_sheet(by_hand, 5))
    in_tiles = prepare(tree, read_profile("hot_tip_250__stretchlon_200")).job
    yield "tiles.svg", page_svg(job_plan(in_tiles))
    vf.fabricate("grid_explorer_pieces", out="pieces", allow_uncalibrated=True)
    yield "pieces.svg", Path("pieces/assembly.svg").read_bytes()
    vf.fabricate("scout", out="scout", allow_uncalibrated=True)
    yield "folds.svg", Path("scout/folds.svg").read_bytes()
    vf.rig(printer="generic_220", out="contact_coupon", contact_test=True)
    yield "contact_test.svg", Path("contact_coupon/contact_test.svg").read_bytes()
    vf.coupon("co2_60w__stretchlon_200", out="coupons")
    yield "joints.webp", webp(Path("coupons/joints.png").read_bytes(), 900)
    vf.report("grid_explorer", environment="grid", count=100, out="report.html")
    yield "report.webp", shot("report.html", (1280, 800))


def maps() -> Iterator[tuple[str, bytes]]:
    """Yield starts, targets, and the walls of a photo."""
    world = vf.maps.grid(seed=3)
    yield "start.svg", svg_bytes(world.with_start("area 20,20 120,480, heading 0+-30"))
    table = vf.Map.read("table.geojson").with_targets("A=460,195", "B=300,330", "shelf=560,330")
    yield "targets.svg", svg_bytes(vf.Design.read("three_level_tree").grow(table))
    vf.examples(out="examples")
    vf.maps.import_(
        "examples/arena/table.jpg",
        marker_mm=30,
        height_mm=30,
        obstacles="50,84,176,75",
        crop_mm=(42, 42, 642, 442),
        out="arena.geojson",
        preview="walls.png",
    )
    yield "walls.webp", webp(Path("walls.png").read_bytes(), 900)
    vf.Map.read("arena.geojson").info(width_mm=28).write("arena.svg")
    yield "arena.svg", Path("arena.svg").read_bytes()


def reality() -> Iterator[tuple[str, bytes]]:
    """Yield the best place of a base, the rig, its base, and photos with their predictions."""
    vf.aim(SPRIG, "arena.geojson", "reach", deployments=20_000, out="aim.svg")
    yield "aim.svg", Path("aim.svg").read_bytes()
    left = vf.Map.read("arena.geojson").with_start("left side, heading 0+-20")
    vf.rig(left, design=SPRIG, out="rig")
    yield "rig.svg", Path("rig/plan.svg").read_bytes()
    vf.rig(left, design="scout", base=True, out="rig_with_base")
    yield "base.svg", Path("rig_with_base/base.svg").read_bytes()
    for number, pose in PHOTOS.items():
        photo = f"examples/arena/grown_{number}.jpg"
        vf.observe(photo, "arena.geojson", SPRIG, pose, obstacle_height_mm=30.0, out="seen.html")
        yield f"seen_{number}.webp", shot("seen.html", (1000, 800), "figure")
        Path("seen.html").unlink()


def pattern_sheet(prepared: Prepared, number: int) -> Page:
    """Return a sheet of the pattern on paper, as it is printed."""
    spec = package_spec(prepared.job, prepared.profile)
    drawing = pattern_page(spec, bar_strokes(spec.job, prepared.profile))
    boxes = np.array([styled.path.contour.box_mm for styled in spec.paths])
    box = *boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0)
    sheet = paper_sheets(drawing, box, "a4", f"{spec.job.name}: pattern")[number]
    high = sheet.page.height_pt
    x, y = PT_PER_MM * np.array(sheet.shift_mm)
    shift = np.array([x, high - y - drawing.height_pt])
    x0, y0, x1, y1 = PT_PER_MM * np.array(sheet.window_mm)
    window = x0, high - y1, x1, high - y0
    layers = []
    for primitive in (one for layer in drawing.layers for one in layer.primitives):
        if isinstance(primitive, Words):
            moved = replace(primitive, at=tuple(shift + primitive.at))
            if not (x0 < moved.at[0] < x1 and window[1] < moved.at[1] < window[3]):
                continue
        else:
            moved = replace(primitive, chains=[chain + shift for chain in primitive.chains])
        layers.append(Layer(primitives=[moved], window=window))
    return replace(sheet.page, layers=[*layers, *sheet.page.layers])


def svg_bytes(noun: vf.Map | vf.Deployment) -> bytes:
    """Return a noun's picture as a notebook shows it."""
    return str(svg_of(noun)).encode()


def shot(page_file: str, size_px: tuple[int, int], place: str = "") -> bytes:
    """Return the first screen of an HTML page, or the first place of a kind on it."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        width, height = size_px
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme="light")
        page.goto(Path(page_file).absolute().as_uri())
        data = page.locator(place).first.screenshot() if place else page.screenshot()
        browser.close()
    return webp(data, size_px[0])


def webp(png: bytes, most_px: int) -> bytes:
    """Return a picture as WebP, at most so wide."""
    picture, stream = Image.open(BytesIO(png)).convert("RGB"), BytesIO()
    picture.thumbnail((most_px, most_px))
    picture.save(stream, "WEBP", quality=80, method=6)
    return stream.getvalue()


if __name__ == "__main__":
    main()
