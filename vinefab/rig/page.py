"""Pictures, assembly drawing and page of a rig; matplotlib is loaded for nothing else of it."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.fabrication.package.package_page import check_section
from vinefab.fabrication.package.sheet_pictures import path_points_mm
from vinefab.model.finding import CheckReport
from vinefab.model.job import Job, Operation
from vinefab.model.map import Map
from vinefab.pages.colours import INK, ROCK, ROCK_EDGE, SOFT, level_colour
from vinefab.pages.drawing import draw_legend, draw_start_range, fill_geometry
from vinefab.pages.figure import house_style, pdf_bytes, plan_axes, png_bytes, svg_bytes
from vinefab.pages.html import Picture, Report, Section, Table, page_html
from vinefab.pages.map_view import UNSEEN_DETAIL, StartMark, start_marks
from vinefab.rig.comparison_with_map import RigComparison
from vinefab.rig.open_shell import shell_words
from vinefab.rig.part import Rig, RigPart
from vinefab.rig.printing import BASIS, Bed, Printing
from vinefab.rig.relief import Colour, Label, Prism, relief_png
from vinefab.rig.rig_plan import polygon_parts
from vinefab.rig.solid import stacked

_TINTS: tuple[Colour, ...] = ((120, 164, 190), (196, 168, 118), (142, 176, 140), (186, 146, 160))
_EXTRA: Colour = (234, 176, 0)
_TABLE: Colour = (214, 219, 222)
_BOARD: Colour = (232, 222, 204)
_MARKER: Colour = (24, 24, 24)
_WHITE: Colour = (250, 250, 250)
_HAIR_MM = 0.01


def assembled_png(rig: Rig, *, width_px: int = 1400) -> bytes:
    """Return a picture of the assembled rig, every part where rig.json puts it."""
    standing, labels = _standing(rig)
    return relief_png([*_board(rig), *standing], labels, width_px=width_px)


def _standing(rig: Rig) -> tuple[list[Prism], list[Label]]:
    """Return every printed part where it stands, and the parts' numbers."""
    solids: list[Prism] = []
    labels: list[Label] = []
    for part in rig.printed:
        points = _on_map(part, rig.options.scale)
        solids.append(
            Prism(
                vertices_mm=points,
                faces=part.faces,
                colour=_tint(part),
                light_from_mm=_light_from_mm(part, points, 0.5 * rig.options.height_mm),
                below=_WHITE if part.colour_change_mm else None,
            )
        )
        if part.number:
            labels.append(Label(text=str(part.number), at_mm=_spot(part, points)))
    return solids, labels


def bed_png(rig: Rig, bed: Bed, *, width_px: int = 700) -> bytes:
    """Return a picture of one bed as it is printed, the printer's plate below."""
    printer = rig.printer
    solids = [_plate(printer.bed_width_mm, printer.bed_depth_mm)]
    labels = []
    for at in bed.places:
        part = rig.printed[at.index]
        points = part.vertices_mm + np.array([at.x_mm, at.y_mm, 0.0])
        solids.append(
            Prism(
                vertices_mm=points,
                faces=part.faces,
                colour=_tint(part),
                light_from_mm=_light_from_mm(part, points, 0.5 * part.size_mm[2]),
                below=_WHITE if part.colour_change_mm else None,
            )
        )
        if part.number:
            labels.append(Label(text=str(part.number), at_mm=_spot(part, points)))
    return relief_png(solids, labels, width_px=width_px)


_CAP_LIFT_MM = 12.0


def base_png(rig: Rig, *, width_px: int = 900) -> bytes | None:
    """Return a picture of the base holder from behind the entry, its cap lifted; None without."""
    solids: list[Prism] = []
    for part in rig.extras:
        if part.name.startswith("base_"):
            lift_mm = _CAP_LIFT_MM if part.name == "base_cap" else 0.0
            points = _on_map(part, rig.options.scale) + np.array([0.0, 0.0, lift_mm])
            solids.append(Prism(vertices_mm=points, faces=part.faces, colour=_TINTS[len(solids)]))
    return relief_png(solids, width_px=width_px, rise_deg=40.0) if solids else None


def _board(rig: Rig) -> list[Prism]:
    """Return the board that loose obstacles stand on; tiles bring their own plate."""
    if rig.style == "plate":
        return []
    plate_mm = rig.options.plate_mm
    board = _slab(rig, shapely.union(rig.plate, rig.pads), (-plate_mm, 0.0), _BOARD)
    cells = _slab(rig, rig.cells, (-_HAIR_MM, 5.0 * _HAIR_MM), _MARKER)
    return [*board, *cells]


def _slab(
    rig: Rig, shape: BaseGeometry, heights_mm: tuple[float, float], colour: Colour
) -> list[Prism]:
    """Return a shape of the map as a slab of the rig; none of an empty one."""
    scale, (low_mm, high_mm) = rig.options.scale, heights_mm
    pieces = polygon_parts(shapely.transform(shape, lambda points: scale * points), Polygon())
    if not len(pieces):
        return []
    vertices, faces = stacked(pieces, polygon_parts(Polygon()), high_mm - low_mm, 0.0)
    return [Prism(vertices_mm=vertices + np.array([0.0, 0.0, low_mm]), faces=faces, colour=colour)]


def _spot(part: RigPart, points_mm: Floats) -> tuple[float, float, float]:
    """Return where a part's number is written: the middle of a tile, or the top of a piece."""
    top_mm = float(points_mm[:, 2].max())
    if part.row:
        x_mm, y_mm = 0.5 * (points_mm.min(axis=0) + points_mm.max(axis=0))[:2]
        return float(x_mm), float(y_mm), top_mm
    corners = points_mm[part.faces]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    x_mm, y_mm, z_mm = corners[int(doubled.argmax())].mean(axis=0).tolist()
    return x_mm, y_mm, z_mm


def _light_from_mm(part: RigPart, points_mm: Floats, floor_mm: float) -> float:
    """Return below which height the tops of a part are drawn pale, or in its first colour."""
    if part.colour_change_mm:
        return float(points_mm[:, 2].min()) + part.colour_change_mm + _HAIR_MM
    return floor_mm if part.number else -np.inf


def _tint(part: RigPart) -> Colour:
    """Return a colour in which neighbouring tiles differ."""
    if part.colour_change_mm:
        return _MARKER
    if not part.number:
        return _EXTRA
    if part.row:
        return _TINTS[2 * (part.row % 2) + part.column % 2]
    return _TINTS[part.number % len(_TINTS)]


def _on_map(part: RigPart, scale: float) -> Floats:
    """Return a part's corners where they stand, in millimetres of the rig."""
    return np.asarray(scale * (part.vertices_mm @ part.to_map[:3, :3].T + part.to_map[:3, 3]))


def _plate(width_mm: float, depth_mm: float) -> Prism:
    """Return the printer's plate: a box of 2 mm below the parts."""
    x, y, z = np.meshgrid([0.0, width_mm], [0.0, depth_mm], [-2.0, 0.0], indexing="ij")
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    sides = [(1, 5, 7, 3), (0, 4, 5, 1), (4, 6, 7, 5), (6, 2, 3, 7), (2, 0, 1, 3), (0, 2, 6, 4)]
    faces = [corner for a, b, c, d in sides for corner in ((a, b, c), (a, c, d))]
    return Prism(vertices_mm=points, faces=np.array(faces), colour=_TABLE)


_SEAM = level_colour(2)
_CUT = "#d00000"
_THICKENED = level_colour(4)


def assembly_plan(rig: Rig, world: Map, outlines: Mapping[int, BaseGeometry]) -> Figure:
    """Return the numbered plan of a rig, in millimetres of the rig from its lower left corner."""
    x_mm, y_mm = rig.plate.bounds[:2]
    scale = rig.options.scale

    def on_rig(shape: BaseGeometry) -> BaseGeometry:
        return shapely.transform(shape, lambda points: scale * (points - (x_mm, y_mm)))

    plate = on_rig(rig.plate)
    _, _, wide_mm, deep_mm = plate.bounds
    with house_style():
        figure, axes = plan_axes((0.0, 0.0, wide_mm, deep_mm), 7.0)
        fill_geometry(axes, [plate], face="#fbfcfd", edge=SOFT)
        walls = shapely.simplify(on_rig(rig.walls), UNSEEN_DETAIL * max(wide_mm, deep_mm))
        fill_geometry(axes, [walls], face=ROCK, edge=ROCK_EDGE)
        fill_geometry(axes, [on_rig(rig.thickened)], face=_THICKENED, edge=_THICKENED, rank=2)
        for number, outline in outlines.items():
            size = 14 if len(outlines) < 30 else max(3.0, 90.0 / len(outlines) ** 0.5)
            _draw_part(axes, number, on_rig(outline), size)
        for mark in start_marks(world, world.bounds.bounds):
            whole = None if mark.whole is None else on_rig(mark.whole)
            free, fan = tuple(map(on_rig, mark.free)), mark.fan and on_rig(mark.fan)
            draw_start_range(axes, StartMark(whole=whole, free=free, fan=fan))
        for start in world.starts:
            point = on_rig(shapely.Point(start.pose.x_mm, start.pose.y_mm))
            axes.plot(
                *shapely.get_coordinates(point)[0],
                "o",
                color=INK,
                markersize=4,
                mec="white",
                zorder=6,
                label="start",
            )
        _draw_north(axes)
        axes.set_title(_title(rig, len(outlines), (wide_mm, deep_mm)), fontsize=9, loc="left")
        axes.set_xlabel("mm of the rig")
        axes.set_ylabel("mm of the rig")
        if world.starts:
            draw_legend(axes)
    return figure


def _draw_part(axes: Axes, number: int, outline: BaseGeometry, size: float) -> None:
    fill_geometry(axes, [outline], face="none", edge=_SEAM, rank=4)
    biggest = max(shapely.get_parts(outline), key=shapely.area, default=Polygon())
    if biggest.is_empty:
        return
    place = biggest.centroid if biggest.covers(biggest.centroid) else biggest.representative_point()
    axes.annotate(
        str(number),
        (place.x, place.y),
        fontsize=size,
        weight="bold",
        color=INK,
        ha="center",
        va="center",
        path_effects=[Stroke(linewidth=0.2 * size, foreground="white"), Normal()],
        zorder=8,
    )


def _draw_north(axes: Axes) -> None:
    axes.annotate(
        "",
        (1.03, 0.96),
        (1.03, 0.86),
        xycoords="axes fraction",
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.6},
        annotation_clip=False,
    )
    axes.text(1.03, 0.965, "N", transform=axes.transAxes, ha="center", va="bottom", color=INK)


def _title(rig: Rig, count: int, size_mm: tuple[float, float]) -> str:
    thickened = "; yellow: thickened to print" if rig.thickened.area else ""
    return (
        f"{rig.name}: {counted(count, 'part')}, {size_mm[0]:.0f} x {size_mm[1]:.0f} mm, obstacles "
        f"{rig.options.height_mm:g} mm high, scale {rig.options.scale:.4g}{thickened}"
    )


def sheet_plan(job: Job) -> Figure:
    """Return a plan of a sheet for the laser: cuts and marks, without numbers."""
    with house_style():
        figure, axes = plan_axes((0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm), 7.0)
        fill_geometry(
            axes,
            [shapely.box(0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)],
            face="#fbfcfd",
            edge=SOFT,
        )
        for operation, colour in ((Operation.MARK, INK), (Operation.CUT, _CUT)):
            lines = [path_points_mm(path) for path in job.along(operation)]
            axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.7, zorder=3))
        axes.set_title(f"{job.name}: red is cut, black is marked", fontsize=9, loc="left")
    return figure


MOST_BEDS = 24
"""A page shows at most so many beds; the folder has a picture of each."""


def rig_section(
    rig: Rig, printing: Printing, pictures: Mapping[str, bytes], why_style: str
) -> Section:
    """Return the section about a rig."""
    sheets = [name for name in pictures if name.startswith(("board", "lid"))]
    marked = rig.options.marker_kind != "none"
    shown = [
        ("assembled.png", "The assembled rig (computed from the files' triangles).", True),
        ("base_holder.png", "The base holder: dial, block, and cap, lifted here.", False),
        ("assembly.svg", "Where each part goes; the arrow points to the map's north.", True),
        *(
            (f"{bed.name}.png", f"{bed.name}: {bed.estimate.words()} (estimate)", False)
            for bed in printing.beds[:MOST_BEDS]
        ),
        *((name, f"{name}: a sheet for the laser.", True) for name in sorted(sheets)[:MOST_BEDS]),
    ]
    return Section(
        title="Test rig",
        paragraphs=(
            f"Printing on {rig.printer.name} takes about {printing.total.words()}: {BASIS}.",
            *(
                f"{words[0].upper()}{words[1:]}."
                for words in (why_style, shell_words(rig))
                if words
            ),
            "plan.svg and plan.pdf are the rig's plan at true scale with markers and a ruler: lay "
            "the rig onto it, or draw the map on paper."
            + (" markers.svg and .pdf are paper markers." if marked else ""),
            *(f"Note: {note}." for note in rig.notes),
        ),
        pictures=tuple(
            Picture(image=pictures[name], caption=caption, wide=wide)
            for name, caption, wide in shown
            if name in pictures
        ),
        tables=(_parts(rig, printing),),
    )


def _parts(rig: Rig, printing: Printing) -> Table:
    rows: Sequence[tuple[str, ...]] = [
        (
            str(part.number or ""),
            f"{part.name}.stl",
            printing.bed_of(index).name,
            " x ".join(f"{size:.1f}" for size in part.size_mm),
            f"{part.volume_mm3 / 1000.0:.1f}",
        )
        for index, part in enumerate(rig.printed)
    ]
    return Table(
        caption="Parts (computed)",
        headings=("number", "file", "bed", "size as printed, mm", "volume, cm3"),
        rows=tuple(rows),
    )


ProgressCallback = Callable[[float, str], None]
"""Called with the share of the work that is done, 0 to 1, and the next step."""


def rig_pictures(
    rig: Rig,
    world: Map,
    outlines: dict[int, BaseGeometry],
    printing: Printing,
    progress: ProgressCallback,
) -> dict[str, bytes]:
    """Return every picture of a rig by file name."""
    progress(0.5, "drawing the plan")
    plan = assembly_plan(rig, world, outlines)
    files = {"assembly.svg": svg_bytes(plan), "assembly.pdf": pdf_bytes(plan)}
    files["assembled.png"] = assembled_png(rig)
    base = base_png(rig)
    files |= {"base_holder.png": base} if base else {}
    for done, bed in enumerate(printing.beds, 1):
        progress(0.5 + 0.5 * done / (len(printing.beds) + 1), f"drawing {bed.name}")
        files[f"{bed.name}.png"] = bed_png(rig, bed)
    return files


def sheet_pictures(jobs: Mapping[str, Job]) -> dict[str, bytes]:
    """Return a picture of every sheet for the laser, by file name."""
    return {f"{Path(name).stem}.png": png_bytes(sheet_plan(job)) for name, job in jobs.items()}


def rig_page(rig: Rig, section: Section, report: CheckReport, comparison: RigComparison) -> str:
    """Return the page about a rig as HTML."""
    wide_mm, deep_mm = (
        rig.options.scale * (high - low)
        for low, high in zip(rig.plate.bounds[:2], rig.plate.bounds[2:], strict=True)
    )
    found = len(report.findings)
    return page_html(
        Report(
            title=f"{rig.name}: test rig",
            verdict=f"{counted(len(rig.parts), 'part')}; every file read back closed and "
            "oriented; assembled, "
            f"the walls differ from the map by {100 * comparison.share:.4f} %; "
            f"{counted(found, 'finding')}",
            tone="bad" if found else "good",
            facts=(
                ("size", f"{wide_mm:.0f} x {deep_mm:.0f} mm"),
                ("scale", f"{rig.options.scale:.4g}"),
                ("obstacles", f"{rig.options.height_mm:g} mm high"),
                ("printer", rig.printer.name),
                ("volume", f"{rig.volume_mm3 / 1000.0:.0f} cm3 (computed)"),
            ),
            sections=(section, check_section(report)),
        )
    )
