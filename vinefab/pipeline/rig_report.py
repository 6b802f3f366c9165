"""Pictures, assembly drawing and page of a rig; matplotlib is loaded for nothing else of it."""

from collections.abc import Callable, Mapping
from pathlib import Path

from shapely.geometry.base import BaseGeometry

from vinefab.model.finding import CheckReport
from vinefab.model.job import Job
from vinefab.model.map import Map
from vinefab.report.content import Report, Section
from vinefab.report.figure import pdf_bytes, png_bytes, svg_bytes
from vinefab.report.making import check_section
from vinefab.report.page import page_html
from vinefab.report.rig_pictures import assembled_png, bed_png, layered_png
from vinefab.report.rig_plan import assembly_plan, sheet_plan
from vinefab.rig.assembled import Comparison
from vinefab.rig.part import Rig
from vinefab.rig.printing import Printing

Tell = Callable[[float, str], None]
"""Called with the share of the work that is done, 0 to 1, and a few words."""


def rig_pictures(
    rig: Rig, world: Map, outlines: dict[int, BaseGeometry], printing: Printing, tell: Tell
) -> dict[str, bytes]:
    """Return every picture of a rig by file name.

    Parameters
    ----------
    rig, world, printing
        The rig, its map and its beds.
    outlines
        What the assembly drawing numbers, in map coordinates.
    tell
        Told what is being drawn; this is the second half of the work on a rig.
    """
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


def rig_page(rig: Rig, section: Section, report: CheckReport, comparison: Comparison) -> str:
    """Return the page about a rig as HTML.

    Parameters
    ----------
    rig, section
        The rig, and the section about it.
    report, comparison
        What the rules say, and how the assembled rig compares with the map.
    """
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
