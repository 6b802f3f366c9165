"""Pictures, assembly drawing and page of a rig; matplotlib is loaded for nothing else of it."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from shapely.geometry.base import BaseGeometry

from vinefab.fabrication.package.package_page import check_section
from vinefab.model.finding import CheckReport
from vinefab.model.job import Job
from vinefab.model.map import Map
from vinefab.pages.figure import pdf_bytes, png_bytes, svg_bytes
from vinefab.pages.html import Picture, Report, Section, Table, page_html
from vinefab.rig.comparison_with_map import RigComparison
from vinefab.rig.part import Rig
from vinefab.rig.pictures import assembled_png, assembly_plan, bed_png, layered_png, sheet_plan
from vinefab.rig.printing import BASIS, Printing

MOST_BEDS = 24
"""A page shows at most so many beds; the folder has a picture of each."""


def rig_section(rig: Rig, printing: Printing, pictures: Mapping[str, bytes]) -> Section:
    """Return the section about a rig."""
    sheets = [name for name in pictures if name.startswith(("board", "lid", "layers"))]
    shown = [
        ("assembled.png", "The assembled rig (computed from the files' triangles).", True),
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


Tell = Callable[[float, str], None]
"""Called with the share of the work that is done, 0 to 1, and a few words."""


def rig_pictures(
    rig: Rig, world: Map, outlines: dict[int, BaseGeometry], printing: Printing, tell: Tell
) -> dict[str, bytes]:
    """Return every picture of a rig by file name."""
    tell(0.5, "drawing the plan")
    plan = assembly_plan(rig, world, outlines)
    files = {"assembly.svg": svg_bytes(plan), "assembly.pdf": pdf_bytes(plan)}
    files["assembled.png"] = layered_png(rig) if rig.style == "sheet" else assembled_png(rig)
    for done, bed in enumerate(printing.beds, 1):
        tell(0.5 + 0.5 * done / (len(printing.beds) + 1), f"drawing {bed.name}")
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
            verdict=f"{len(rig.parts)} parts; every file read back closed and oriented; assembled, "
            f"the walls differ from the map by {100 * comparison.share:.4f} %; {found} findings",
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
