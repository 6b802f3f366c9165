"""The contract of every registered laser format: what it writes is read back and compared.

A format that is added to the registry is tested here without a line about it, but for those of
tools that no laser recipe has: `test_gcode_format.py`.
"""

import csv
import json
import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from vinefab.core.errors import BadInputError, ReadBackError
from vinefab.core.registry import Registry
from vinefab.fabrication.calibration.coupons import coupon_pieces, coupon_sheets, energy_matrix
from vinefab.fabrication.formats import laser_formats
from vinefab.fabrication.formats.laser_drawing import (
    DEFAULT,
    PRESETS,
    LaserFileSpec,
    LaserFormat,
    file_problems,
)
from vinefab.fabrication.formats.laser_formats import (
    LASER_FORMATS,
    ensure_read_back,
    format_problem,
    laser_files,
)
from vinefab.fabrication.formats.svg_format import SVG, read_svg
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, read_profile
from vinefab.model.machine import Tool
from vinefab.model.outline import Contour

JOBS = ("one pass", "two passes", "pouches", "several", "coupons", "energy matrix")
FORMATS = sorted(
    name
    for name, one in LASER_FORMATS.items()
    # The other paper has the same writer and reader.
    if (not one.tools or Tool.LASER in one.tools) and one.paper in ("", "a4")
)
WITH_SETTINGS = [name for name in FORMATS if LASER_FORMATS[name].needs_profile]


@cache
def recipe() -> LaserProfile:
    return read_profile("co2_60w__stretchlon_200")


@cache
def real_job(name: str) -> Job:
    profile, tree = recipe(), Design.read("three_level_tree")
    if name == "two passes":
        return laser_job(tree, profile, SheetOptions(process="weld+cut"))
    if name == "pouches":
        return laser_job(Design.read("six_branch_anchor"), profile)
    if name == "several":
        return laser_job(Design.read("plain_vine"), profile, SheetOptions(copies=3))
    if name == "coupons":
        return coupon_sheets(coupon_pieces(profile), profile)[0]
    if name == "energy matrix":
        return energy_matrix(profile).jobs[1]
    return laser_job(tree, profile)


def spec_of(name: str) -> LaserFileSpec:
    return LaserFileSpec(job=real_job(name), profile=recipe())


def problems(laser_format: LaserFormat, written: LaserFileSpec, meant: LaserFileSpec) -> str:
    """Return what comparing a file with another job than it was written from finds."""
    return "; ".join(
        file_problems(
            laser_format, laser_format.write(written).encode(laser_format.encoding), meant
        )
    )


def changed(spec: LaserFileSpec, index: int, *paths: LaserPath) -> LaserFileSpec:
    """Return a spec with a path replaced, or left out."""
    before = spec.job.paths
    return replace(
        spec, job=replace(spec.job, paths=(*before[:index], *paths, *before[index + 1 :]))
    )


def machined(job: Job) -> list[int]:
    return [at for at, path in enumerate(job.paths) if path.operation.is_machined]


@pytest.mark.parametrize("name", FORMATS)
def test_a_registered_format_is_complete(name: str) -> None:
    assert format_problem(name, LASER_FORMATS[name]) == ""


@pytest.mark.parametrize("job", JOBS)
@pytest.mark.parametrize("name", FORMATS)
def test_real_jobs_are_written_and_read_back(name: str, job: str) -> None:
    assert problems(LASER_FORMATS[name], spec_of(job), spec_of(job)) == ""


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("name", FORMATS)
def test_every_colour_preset_is_read_back(name: str, preset: str) -> None:
    spec = replace(spec_of("one pass"), colours=PRESETS[preset])
    assert problems(LASER_FORMATS[name], spec, spec) == ""


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_job_gives_the_same_text(name: str) -> None:
    one = LASER_FORMATS[name]
    assert one.write(spec_of("one pass")) == one.write(spec_of("one pass"))


@pytest.mark.parametrize("job", ["one pass", "energy matrix"])
@pytest.mark.parametrize("name", FORMATS)
def test_a_path_moved_by_five_tolerances_is_found(name: str, job: str) -> None:
    one, meant = LASER_FORMATS[name], spec_of(job)
    at = machined(meant.job)[-1]
    path = meant.job.paths[at]
    for shift in ((5.0 * one.tolerance_mm, 0.0), (0.0, -5.0 * one.tolerance_mm)):
        moved = replace(path, contour=path.contour.moved(0.0, *shift))
        assert "mm away" in problems(one, changed(meant, at, moved), meant)
    near = replace(path, contour=path.contour.moved(0.0, 0.1 * one.tolerance_mm, 0.0))
    assert problems(one, changed(meant, at, near), meant) == ""


@pytest.mark.parametrize("name", FORMATS)
def test_one_corner_moved_by_five_tolerances_is_found(name: str) -> None:
    one, meant = LASER_FORMATS[name], spec_of("energy matrix")
    at = machined(meant.job)[-1]
    path = meant.job.paths[at]
    points = path.contour.points_mm.copy()
    points[-1, 1] += 5.0 * one.tolerance_mm
    bent = replace(path, contour=Contour.polyline(points, closed=path.contour.closed))
    assert "mm away" in problems(one, changed(meant, at, bent), meant)


@pytest.mark.parametrize("name", FORMATS)
def test_a_missing_an_added_and_an_open_path_are_found(name: str) -> None:
    one, meant = LASER_FORMATS[name], spec_of("one pass")
    at = machined(meant.job)[-1]
    path = meant.job.paths[at]
    assert problems(one, changed(meant, at), meant)
    assert "paths, not" in problems(one, changed(meant, at, path, path), meant)
    at = next(at for at in machined(meant.job) if len(meant.job.paths[at].contour.points_mm) > 2)
    path = meant.job.paths[at]
    points = path.contour.points_mm
    other = replace(path, contour=Contour.polyline(points, closed=not path.contour.closed))
    straight = replace(path, contour=Contour.polyline(points, closed=path.contour.closed))
    assert problems(one, changed(meant, at, other), changed(meant, at, straight))


@pytest.mark.parametrize("name", FORMATS)
def test_a_path_on_the_layer_of_another_operation_is_found(name: str) -> None:
    one, meant = LASER_FORMATS[name], spec_of("one pass")
    swap = {Operation.WELDCUT: Operation.CUT, Operation.CUT: Operation.WELDCUT}
    for at, path in enumerate(meant.job.paths):
        if path.operation in swap:
            wrong = replace(path, operation=swap[path.operation])
            assert "layer" in problems(one, changed(meant, at, wrong), meant)


@pytest.mark.parametrize("name", [name for name in FORMATS if name.startswith(("dxf", "svg"))])
def test_a_sheet_of_another_size_is_found(name: str) -> None:
    one, meant = LASER_FORMATS[name], spec_of("one pass")
    larger = replace(meant.job, sheet_width_mm=meant.job.sheet_width_mm + 5 * one.tolerance_mm)
    assert "sheet" in problems(one, replace(meant, job=larger), meant)


@pytest.mark.parametrize("name", WITH_SETTINGS)
def test_another_power_is_found(name: str) -> None:
    one, meant = LASER_FORMATS[name], spec_of("one pass")
    profile = recipe()
    cut = profile.settings(Operation.CUT)
    stronger = cut.changed(
        power_percent=cut.power_percent.changed(value=cut.power_percent.value + 1)
    )
    operations = {**profile.recipe.by_operation, "cut": stronger}
    other = replace(profile, recipe=profile.recipe.changed(operations=operations))
    assert "maxPower" in problems(one, replace(meant, profile=other), meant)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("data", [None, b"", b"\xff\xfe\x00", b"<a/>", b"0\nEOF\n"])
def test_any_other_file_is_found(name: str, data: bytes | None) -> None:
    assert file_problems(LASER_FORMATS[name], data, spec_of("one pass"))


def test_every_file_that_is_written_has_been_read_back(monkeypatch: pytest.MonkeyPatch) -> None:
    read = []

    def counted(one: LaserFormat) -> LaserFormat:
        return replace(one, read=lambda text: (read.append(text), one.read(text))[1])

    watched = {name: counted(one) for name, one in LASER_FORMATS.items()}
    monkeypatch.setattr(laser_formats, "LASER_FORMATS", Registry("laser format", watched))
    written = laser_files(spec_of("one pass"), requested=FORMATS)
    found = {
        data.decode("latin-1" if name.endswith(".pdf") else "utf-8")
        for name, data in written.files.items()
    }
    assert set(read) == found
    assert len(read) == len(written.files)
    steps = sum(3 for name in FORMATS if LASER_FORMATS[name].each_operation)
    assert len(written.files) == len(FORMATS) + steps
    assert set(written.problems) == set(written.files)


def test_a_format_without_a_reader_is_refused() -> None:
    for name in ("read", "write"):
        with pytest.raises(BadInputError, match=rf"laser format SVG in millimetres: {name} is"):
            replace(SVG, **{name: None})
    with pytest.raises(TypeError, match="read"):
        LaserFormat(title="toy", suffix=".toy", write=SVG.write, tolerance_mm=1e-3)  # type: ignore[call-arg]


@pytest.mark.parametrize(
    "change", [{"suffix": "svg"}, {"suffix": "/etc/x.svg"}, {"tolerance_mm": 0.5}]
)
def test_a_format_without_a_suffix_or_with_a_large_tolerance_is_refused(
    change: dict[str, object],
) -> None:
    with pytest.raises(BadInputError, match=next(iter(change))):
        replace(SVG, **change)


def test_what_is_no_format_and_a_suffix_that_is_taken_are_refused() -> None:
    assert "not a LaserFormat" in format_problem("toy", read_svg)
    assert "like those of svg" in format_problem("toy", replace(SVG, title="toy"))


GCODE = """
import re

from vinefab.core.errors import UnreadableFileError
from vinefab.fabrication.formats.laser_drawing import (
    DrawnPath, LaserFormat, ReadDrawing, flattened_contour,
)
from vinefab.model.outline import FLATTEN_MM, Contour


def write(spec):
    lines = ["G21 G90 (millimetres, absolute)"]
    for styled in spec.paths:
        contour = flattened_contour(styled.path.contour)
        points = contour.points_mm.tolist()
        if contour.closed:
            points.append(points[0])
        shape = "closed" if contour.closed else "open"
        lines.append(f"({styled.style.layer} {styled.style.rgb} {shape})")
        lines += [f"G{min(k, 1)} X{x:.6f} Y{y:.6f}" for k, (x, y) in enumerate(points)]
    return "\\n".join([*lines, "M5", ""])


def read(text):
    if not text.startswith("G21 G90") or not text.endswith("M5\\n"):
        raise UnreadableFileError("G-code", "is none of ours, or is cut")
    paths = []
    for block in text.split("(VF_")[1:]:
        layer, colour, shape = block.partition(")")[0].split()
        points = [[float(x), float(y)] for x, y in re.findall(r"X(\\S+) Y(\\S+)", block)]
        closed = shape == "closed"
        contour = Contour.polyline(points[: len(points) - closed], closed=closed)
        paths.append(DrawnPath(layer=f"VF_{layer}", colour=colour, contour=contour))
    return ReadDrawing(paths=tuple(paths))


FORMAT = LaserFormat(
    title="G-code", use="for machines without a program of their own", suffix=".ngc",
    write=write, read=read, tolerance_mm=1e-5, contour=flattened_contour, sagitta_mm=FLATTEN_MM,
)
"""
LINE = "ngc = their_gcode:FORMAT\n"


@pytest.fixture
def gcode(tmp_path: Path) -> Path:
    """Another package with a laser format: one file and one line."""
    folder = tmp_path / "site"
    facts = folder / "theirs-1.0.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(f"[vinefab.laser_formats]\n{LINE}")
    (folder / "their_gcode.py").write_text(GCODE)
    return folder


def fabricate(
    site: Path, out: Path, design: str = "plain_vine"
) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([str(site), *sys.path])
    command = ["fabricate", design, "--out", str(out), "--allow-uncalibrated"]
    return subprocess.run(
        [sys.executable, "-m", "vinefab", *command],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=120,
    )


@pytest.mark.parametrize(
    ("design", "stem"),
    [
        ("plain_vine", "outline"),
        pytest.param("grid_explorer_pieces_levels", "sheet_1/outline", marks=pytest.mark.thorough),
    ],
)
def test_a_new_format_is_one_file_and_one_line_and_every_text_names_it(
    gcode: Path, tmp_path: Path, design: str, stem: str
) -> None:
    out = tmp_path / "package"
    done = fabricate(gcode, out, design)
    assert done.returncode == 0, done.stderr
    assert (out / f"{stem}.ngc").read_text().startswith("G21 G90")
    assert f"{stem}.ngc" in (out / "MANIFEST.sha256").read_text()
    readme = " ".join((out / "README.txt").read_text().split())
    words = "outline.ngc: G-code; for machines without a program of their own; from theirs; "
    words += "one operation alone: outline_mark.ngc, outline_weldcut.ngc, outline_cut.ngc."
    assert words in readme
    assert f"{stem}.ngc: see Files), in millimetres" in readme
    content = json.loads((out / "job.json").read_text())
    alone = [f"{stem}_{name}.ngc" for name in ("mark", "weldcut", "cut")]
    assert all((out / name).is_file() for name in alone)
    assert content["formats"][-1] == {
        "name": "ngc",
        "files": [f"{stem}.ngc", *alone],
        "title": "G-code",
        "use": "for machines without a program of their own",
        "package": "theirs",
    }
    assert all(f"{stem}.ngc" in one["files"] for one in content.get("sheets", [])[:1])
    rows = csv.reader((out / "bom.csv").read_text().splitlines())
    (row,) = (r for r in rows if r[0] == "files with paths")
    assert ".ngc" in row[-1]
    # What is named is there, and what is there is named.
    named = {name for one in content["formats"] for name in one["files"]}
    ends = tuple(one["files"][0].removeprefix(stem) for one in content["formats"])
    written = {path.relative_to(out).as_posix() for path in out.rglob("*outline*")}
    assert named == {name for name in written if name.endswith(ends)}
    assert int(row[1]) == len(named)


def test_a_new_format_that_writes_a_path_elsewhere_never_ships(gcode: Path, tmp_path: Path) -> None:
    source = gcode / "their_gcode.py"
    source.write_text(source.read_text().replace(":.6f", ":.1f"))
    done = fabricate(gcode, tmp_path / "package")
    assert done.returncode == 1
    assert "outline.ngc" in done.stdout
    assert "mm away from where it should be" in done.stdout
    assert not (tmp_path / "package").exists()


def test_a_new_format_without_a_reader_is_not_registered(gcode: Path, tmp_path: Path) -> None:
    source = gcode / "their_gcode.py"
    source.write_text(source.read_text().replace("read=read", "read=None"))
    out = tmp_path / "package"
    done = fabricate(gcode, out)
    assert done.returncode == 0
    assert "laser format ngc not loaded: BadInputError: laser format G-code: read" in done.stdout
    assert not (out / "outline.ngc").exists()


def test_a_difference_is_an_error_with_the_files_name() -> None:
    ensure_read_back({"a.dxf": ()})
    with pytest.raises(ReadBackError, match=r"b\.svg"):
        ensure_read_back({"a.dxf": (), "b.svg": ("the unit is in, not mm",)})


def test_a_file_with_settings_needs_a_profile() -> None:
    spec = LaserFileSpec(job=real_job("one pass"), colours=DEFAULT)
    assert not {LASER_FORMATS[name].file_name() for name in WITH_SETTINGS} & set(
        laser_files(spec).files
    )
    for name in WITH_SETTINGS:
        with pytest.raises(BadInputError, match="profile"):
            LASER_FORMATS[name].write(spec)
