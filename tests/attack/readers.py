"""A coverage-guided fuzz of the readers of maps: ``python tests/attack/readers.py 600`` (seconds).

atheris changes the files of a corpus (`stock`, all ours) and keeps the changes that reach new
branches of vinefab's importers. A reader must return a map or raise an error of vinefab's that is
one line. A failing input is kept, and its path printed; ``readers.py FILE`` tries it again.
"""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "maps" / "importers"))

import atheris
from files import CSV, GEOJSON, IMAGE, ROS, SVG, write_drawings

with atheris.instrument_imports(include=["vinefab.maps.importers", "vinefab.maps.cleanup"]):
    from vinefab.core.errors import VinefabError
    from vinefab.maps.importers import (
        csv_polygons,  # noqa: F401  loaded here, so that its branches are seen
        dxf_drawing,  # noqa: F401
        geojson_any,  # noqa: F401
        ros_map,  # noqa: F401
        svg_drawing,  # noqa: F401
    )
    from vinefab.maps.importers.import_options import ImportOptions
    from vinefab.maps.importers.importers import import_suffixes

from against_chromium import drawing  # it loads the importers too: they are seen by now

KINDS = (".svg", ".dxf", ".geojson", ".csv", ".yaml")
OPTIONS = (
    {},
    {"drawn": "free"},
    {"bounds": "box"},
    {"wall_mm": 2.0, "open_lines": "wall"},
    {"open_lines": "drop", "flatten": True},
)
LONGEST_BYTES = 20_000


def stock(folder: Path) -> None:
    """Write the corpus: small files of every kind, each after a byte for kind and options."""
    write_drawings(folder)
    texts = {".svg": [SVG], ".geojson": [GEOJSON], ".csv": [CSV, CSV.replace(",", ";")]}
    texts |= {".dxf": [(folder / "plan.dxf").read_text()], ".yaml": [ROS.format(image="cells.pgm")]}
    texts[".svg"] += [drawing(seed) for seed in range(12)]
    corpus = folder / "corpus"
    corpus.mkdir()
    for kind, suffix in enumerate(KINDS):
        for number, text in enumerate(texts[suffix]):
            for option in range(len(OPTIONS)):
                name = f"{suffix[1:]}_{number}_{option}"
                (corpus / name).write_bytes(bytes([kind + len(KINDS) * option]) + text.encode())
    (folder / "cells.pgm").write_bytes(IMAGE)


def read(data: bytes, folder: Path) -> None:
    """Read one input; what is not an error of vinefab's in one line is raised."""
    if len(data) < 2:
        return
    option, kind = divmod(data[0] % (len(KINDS) * len(OPTIONS)), len(KINDS))
    path = folder / f"tried{KINDS[kind]}"
    path.write_bytes(data[1:])
    try:
        import_suffixes()[KINDS[kind]].read(path, ImportOptions(**OPTIONS[option]))
    except VinefabError as error:
        if "\n" in str(error) or not str(error):
            raise AssertionError(f"not one line: {error!r}") from error


def main(arguments: list[str]) -> None:
    """Fuzz for some seconds, or try one file."""
    folder = Path(tempfile.mkdtemp(prefix="readers-"))
    stock(folder)
    if arguments and not arguments[0].isdigit():
        read(Path(arguments[0]).read_bytes(), folder)
        return
    seconds = arguments[0] if arguments else "600"
    limits = [f"-max_total_time={seconds}", f"-max_len={LONGEST_BYTES}", "-timeout=60"]
    found = f"-artifact_prefix={folder}/"
    atheris.Setup(
        [sys.argv[0], *limits, "-rss_limit_mb=4000", found, str(folder / "corpus")],
        lambda data: read(data, folder),
    )
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1:])
