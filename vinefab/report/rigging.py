"""The section about a test rig: pictures, assembly drawing, part list, what printing takes."""

from collections.abc import Mapping, Sequence

from vinefab.report.content import Picture, Section, Table
from vinefab.rig.estimate import BASIS
from vinefab.rig.part import Rig
from vinefab.rig.printing import Printing

MOST_BEDS = 24
"""A page shows at most so many beds; the folder has a picture of each."""


def rig_section(rig: Rig, printing: Printing, pictures: Mapping[str, bytes]) -> Section:
    """Return the section about a rig.

    Parameters
    ----------
    rig, printing
        The rig and its beds.
    pictures
        ``assembled.png``, ``assembly.svg`` and one ``bed_NN.png`` per bed; what is missing is
        left out.
    """
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
