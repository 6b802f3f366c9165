import io
import itertools
import json
import math
import subprocess
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import shapely

from vinefab.core.plain_text import OWN_MARK
from vinefab.fabrication.formats import dxf_format as dxf
from vinefab.fabrication.formats.dxf_format import DXF_R12, dxf_text, read_dxf
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec, drawing_differences
from vinefab.model.job import Job, Operation
from vinefab.model.outline import Contour, Segment


@dataclass
class Polyline:
    """What the group codes of one LWPOLYLINE say."""

    layer: str = ""
    colour: int = 256
    flags: int = 0
    count: int = 0
    vertices: list[list[float]] = field(default_factory=list)

    def take(self, code: int, value: str) -> None:
        if code == 10:
            self.vertices.append([float(value), math.nan, 0.0])
        elif code in (20, 42):
            self.vertices[-1][1 if code == 20 else 2] = float(value)
        else:
            name = {8: "layer", 62: "colour", 70: "flags", 90: "count"}.get(code)
            if name:
                setattr(self, name, type(getattr(self, name))(value))

    @property
    def length(self) -> float:
        ends = self.vertices[1:] + (self.vertices[:1] if self.flags & 1 else [])
        total = 0.0
        for (x0, y0, bulge), (x1, y1, _) in zip(self.vertices, ends, strict=False):
            chord, turn = math.hypot(x1 - x0, y1 - y0), 4 * math.atan(abs(bulge))
            total += chord * (turn / 2) / math.sin(turn / 2) if turn else chord
        return total


@dataclass
class Plain:
    """A DXF file read by its group codes alone."""

    kinds: list[str]
    polylines: list[Polyline]
    header: dict[str, str]
    layers: dict[str, int]


def read_plain(text: str) -> Plain:
    lines = [line.strip() for line in text.split("\n")]
    pairs = [(int(code), value) for code, value in zip(lines[::2], lines[1::2], strict=False)]
    starts = [at for at, (code, _) in enumerate(pairs) if code == 0]
    records = [pairs[a:b] for a, b in zip(starts, [*starts[1:], len(pairs)], strict=True)]
    plain, section = Plain([], [], {}, {}), ""
    for record in records:
        kind, facts = record[0][1], dict(reversed(record))
        section = facts[2] if kind == "SECTION" else "" if kind == "ENDSEC" else section
        if section == "HEADER":
            plain.header.update(header_variables(record))
        elif section == "TABLES" and kind == "LAYER":
            plain.layers[facts[2]] = int(facts[62])
        elif section == "ENTITIES" and kind != "SECTION":
            plain.kinds.append(kind)
            plain.polylines.append(Polyline())
            for code, value in record:
                plain.polylines[-1].take(code, value)
    return plain


def header_variables(record: list[tuple[int, str]]) -> dict[str, str]:
    follows = itertools.pairwise(record)
    return {name: value for (code, name), (_, value) in follows if code == 9}


def test_an_independent_reader_sees_the_same_paths_in_millimetres(job: Job) -> None:
    mixed = Job(name="mixed", sheet_width_mm=150, sheet_height_mm=80, paths=job.paths[::-1])
    plain = read_plain(dxf_text(mixed))
    assert set(plain.kinds) == {"LWPOLYLINE"}
    assert len(plain.polylines) == len(job.paths)
    inner_first = sorted(mixed.paths, key=lambda path: path.operation.layer)
    for polyline, path in zip(plain.polylines, inner_first, strict=True):
        vertices = np.array(polyline.vertices)
        assert polyline.layer == path.operation.layer
        assert polyline.colour == plain.layers[polyline.layer]
        assert polyline.count == len(path.contour.points_mm)
        assert bool(polyline.flags & 1) is path.contour.closed
        assert np.array_equal(vertices[:, :2], path.contour.points_mm)
        assert np.array_equal(vertices[: len(path.contour), 2], path.contour.bulges)
        assert polyline.length == pytest.approx(path.contour.length_mm, rel=1e-12)
    assert (plain.layers["VF_30_WELDCUT"], plain.layers["VF_40_CUT"]) == (6, 1)
    names = ("$ACADVER", "$INSUNITS", "$MEASUREMENT")
    assert [plain.header[name] for name in names] == ["AC1024", "4", "1"]
    assert float(plain.header["$LIMMAX"]) == 150.0
    assert float(plain.header["$EXTMIN"]) == 5.0


def test_the_file_is_known_as_ours_and_tells_how_it_was_made(job: Job) -> None:
    text = dxf_text(job)
    assert OWN_MARK in text.encode()[:8192]
    document = ezdxf.read(io.StringIO(text))
    auditor = document.audit()
    assert (auditor.errors, auditor.fixes) == ([], [])
    properties = dict(document.header.custom_vars.properties)
    assert properties["offset_mm"] == "0.65"
    assert properties["two lines"] == '["ä", 1]'
    assert "kerf at 0" in properties["kerf"]


def test_the_clock_is_not_in_the_file_and_the_switch_for_that_is_put_back(
    job: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ezdxf.options.write_fixed_meta_data_for_testing is False
    assert dxf_text(job) == dxf_text(job)
    assert ezdxf.options.write_fixed_meta_data_for_testing is False
    monkeypatch.setattr(dxf, "styled_paths", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        dxf_text(job)
    assert ezdxf.options.write_fixed_meta_data_for_testing is False


def test_the_polyline_variant_has_chords_within_a_hundredth_of_a_millimetre(
    one_path: Callable[[Contour], Job], segment_of: Callable[..., Segment]
) -> None:
    arc = segment_of((200.0, 300.0), 37.0, 20.0, 190.0)
    whole = one_path(Contour.from_segments([arc], closed=False))
    (polyline,) = read_plain(dxf_text(whole, polyline=True)).polylines
    vertices = np.array(polyline.vertices)
    assert not vertices[:, 2].any()
    middles = (vertices[1:, :2] + vertices[:-1, :2]) / 2
    sagitta = 37.0 - np.hypot(*(middles - (200.0, 300.0)).T)
    assert 0.002 < sagitta.max() <= 0.01 + 1e-9
    assert np.allclose(np.hypot(*(vertices[:, :2] - (200.0, 300.0)).T), 37.0, atol=1e-9)


def test_ogr_sees_the_layers_lengths_and_boxes(
    job: Job, tmp_path: Path, program: Callable[[str, str], str]
) -> None:
    ogr2ogr = program("ogr2ogr", "gdal-bin")
    source, target = tmp_path / "job.dxf", tmp_path / "job.geojson"
    source.write_text(dxf_text(job), "utf-8")
    # OGR draws arcs as chords; this makes them a quarter of a degree long.
    options = ["--config", "OGR_ARC_STEPSIZE", "0.25", "-lco", "COORDINATE_PRECISION=9"]
    command = [ogr2ogr, "-f", "GeoJSON", *options, "-a_srs", "EPSG:3857", target, source]
    done = subprocess.run(
        command, capture_output=True, text=True, errors="replace", timeout=60, check=True
    )
    assert "ERROR" not in done.stderr
    found = defaultdict(list)
    for feature in json.loads(target.read_text("utf-8"))["features"]:
        shape = shapely.from_geojson(json.dumps(feature["geometry"]))
        found[feature["properties"]["Layer"]].append(shape)
    for operation in Operation:
        shapes = found[operation.layer]
        boxes = np.array([path.contour.box_mm for path in job.along(operation)])
        assert sum(s.length for s in shapes) == pytest.approx(job.length_mm(operation), rel=1e-5)
        assert np.allclose(shapely.bounds(shapes), boxes, atol=1e-3)


def test_release_12_has_the_same_paths_as_old_polylines(
    job: Job, caplog: pytest.LogCaptureFixture
) -> None:
    text = dxf_text(job, r12=True)
    assert caplog.records == []
    document = ezdxf.read(io.StringIO(text))
    assert document.dxfversion == "AC1009"
    assert "$INSUNITS" not in document.header
    polylines = list(document.modelspace())
    assert {polyline.dxftype() for polyline in polylines} == {"POLYLINE"}
    for polyline, path in zip(polylines, job.paths, strict=True):
        rows = [(*v.dxf.location.vec2, v.dxf.get("bulge", 0.0)) for v in polyline.vertices]
        assert np.allclose(np.array(rows)[:, :2], path.contour.points_mm, atol=1e-9)
        assert np.allclose(np.array(rows)[: len(path.contour), 2], path.contour.bulges)
        assert polyline.is_closed is path.contour.closed
        assert polyline.dxf.layer == path.operation.layer
    assert drawing_differences(DXF_R12, read_dxf(text), LaserFileSpec(job=job)) == ()
