"""Pictures, assembly drawing and page of a rig; matplotlib is loaded for nothing else of it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.plain_text import counted
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
from vinefab.rig.part import Rig
from vinefab.rig.printing import BASIS, Printing

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


MOST_SHEETS = 24
"""A page shows at most so many sheets; the folder has a picture of each."""


def rig_section(
    rig: Rig, printing: Printing, pictures: Mapping[str, bytes], why_style: str
) -> Section:
    """Return the section about a rig."""
    sheets = [name for name in pictures if name.startswith(("board", "lid"))]
    marked = rig.options.marker_kind != "none"
    shown = [
        ("assembly.svg", "Where each part goes; the arrow points to the map's north."),
        *((name, f"{name}: a sheet for the laser.") for name in sorted(sheets)[:MOST_SHEETS]),
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
            "plan.svg is the rig's plan at true scale with markers and a ruler: lay "
            "the rig onto it, or draw the map on paper."
            + (" markers.svg has paper markers." if marked else ""),
            *(f"Note: {note}." for note in rig.notes),
        ),
        pictures=tuple(
            Picture(image=pictures[name], caption=caption, wide=True) for name, caption in shown
        ),
        tables=(_beds(printing), _parts(rig, printing)),
    )


def _beds(printing: Printing) -> Table:
    return Table(
        caption="Beds (estimate)",
        headings=("bed", "takes"),
        rows=tuple((bed.name, bed.estimate.words()) for bed in printing.beds),
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


def rig_pictures(
    rig: Rig, world: Map, outlines: Mapping[int, BaseGeometry], jobs: Mapping[str, Job]
) -> dict[str, bytes]:
    """Return the assembly drawing and a picture of every sheet for the laser, by file name."""
    plan = assembly_plan(rig, world, outlines)
    files = {"assembly.svg": svg_bytes(plan), "assembly.pdf": pdf_bytes(plan)}
    sheets = {f"{Path(name).stem}.png": png_bytes(sheet_plan(job)) for name, job in jobs.items()}
    return files | sheets


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
