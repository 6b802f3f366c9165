import io
import zipfile

import lib3mf
import numpy as np
import pytest
from lib3mf import get_wrapper
from shapely import Polygon, box

from vinefab.core.errors import UnreadableFileError
from vinefab.rig.part import RigPart
from vinefab.rig.part_files import PartItem, read_threemf, threemf_bytes
from vinefab.rig.rig_plan import polygon_parts
from vinefab.rig.solid import stacked


@pytest.fixture(scope="module")
def items():
    """Two blocks of 613.32 and 400 mm3 on one bed; a name that XML must escape."""
    high = stacked(polygon_parts(box(0, 0, 20, 10)), polygon_parts(box(3, 3, 8, 8.333)), 2.0, 8.0)
    flat = stacked(polygon_parts(box(0, 0, 20, 10)), polygon_parts(Polygon()), 2.0, 0.0)
    return [
        PartItem(part=_part('a "b" & <c>', high, 613.32), at_mm=(5.0, 5.0)),
        PartItem(part=_part("flat", flat, 400.0), at_mm=(30.25, 5.5)),
    ]


def _part(name, mesh, volume_mm3):
    return RigPart(
        name=name, vertices_mm=mesh[0], faces=mesh[1], to_map=np.eye(4), volume_mm3=volume_mm3
    )


def _strictly(data):
    """Read by the consortium's own library, which refuses what the format does not allow."""
    model = get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)  # noqa: FBT003  its signature
    reader.ReadFromBuffer(data)
    assert reader.GetWarningCount() == 0
    return model


def test_lib3mf_reads_it_strictly(items):
    model = _strictly(threemf_bytes(items, "rig <1> & more"))
    objects, seen = model.GetMeshObjects(), {}
    while objects.MoveNext():
        one = objects.GetCurrentMeshObject()
        assert one.IsManifoldAndOriented()
        seen[one.GetName()] = one.GetTriangleCount()
    assert seen == {item.part.name: len(item.part.faces) for item in items}
    builds, places = model.GetBuildItems(), []
    while builds.MoveNext():
        places.append(tuple(builds.GetCurrent().GetObjectTransform().Fields[3]))
    assert places == [(5.0, 5.0, 0.0), (30.25, 5.5, 0.0)]
    assert model.GetUnit() == lib3mf.ModelUnit.MilliMeter


def test_our_own_reader_finds_all_of_it(items):
    read = read_threemf(threemf_bytes(items, "rig"))
    for item, got in zip(items, read, strict=True):
        assert got.name == item.part.name
        assert got.shift_mm == (*item.at_mm, 0.0)
        assert got.mesh.form_problems() == []
        assert got.mesh.volume_mm3 == pytest.approx(item.part.volume_mm3, rel=1e-6)


def test_the_same_parts_give_the_same_bytes(items):
    data = threemf_bytes(items, "rig")
    assert data == threemf_bytes(items, "rig")
    assert b"written by vinefab" in data[-200:]
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert archive.namelist()[0] == "[Content_Types].xml"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'unit="millimeter"', b'unit="inch"      '),
        (b'transform="1 0', b'transform="2 0'),
        (b'v1="0"', b'v1="9"'),
    ],
)
def test_a_file_that_says_something_else_is_seen(items, old, new):
    data = threemf_bytes(items, "rig")
    assert old in data
    broken = data.replace(old, new, 1)
    with pytest.raises(UnreadableFileError):
        read_threemf(broken)  # the zip's own checksum sees all three


def test_inches_are_refused_even_with_a_right_checksum(items):
    source = zipfile.ZipFile(io.BytesIO(threemf_bytes(items, "rig")))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in source.namelist():
            archive.writestr(name, source.read(name).replace(b"millimeter", b"inch"))
    with pytest.raises(UnreadableFileError, match="the unit is inch"):
        read_threemf(stream.getvalue())
