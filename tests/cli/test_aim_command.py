"""``vinefab aim`` on the command line."""

import json

import pytest
import shapely

from vinefab.cli.main import main
from vinefab.model.map import Map, Pose, Start


@pytest.fixture
def room(tmp_path):
    start = Start(pose=Pose(x_mm=40.0, y_mm=100.0, heading_rad=0.0))
    world = Map(name="room", bounds=shapely.box(0, 0, 400, 200), starts=(start,))
    return world.write(tmp_path / "room.geojson")


def test_aim_prints_a_pose_that_grow_takes(room, tmp_path, capsys):
    arguments = ["aim", "plain_vine", "--map", str(room), "--deployments", "5000"]
    numbers = tmp_path / "aim.json"
    assert main([*arguments, "--json", str(numbers)]) == 0
    out = capsys.readouterr().out
    pose = out.partition("put the base of plain_vine at ")[2].partition(":")[0]
    content = json.loads(numbers.read_text())
    assert content["pose"]["text"] == pose
    again = f"vinefab aim plain_vine {room} --deployments 5000"
    assert content["reproduce"]["command"] == again
    assert main(["grow", "plain_vine", "--map", str(room), "--pose", pose]) == 0


@pytest.mark.parametrize(
    ("extra", "named"),
    [
        (["--where", "moon"], "--where"),
        (["--robots", "0"], "--robots"),
        (["--robots", "2", "--task", "anchoring"], "anchoring"),
        (["--alone", "--against", "plain_vine"], "--alone"),
        (["--deployments", "5"], "--deployments"),
        (["--placing-mm", "nan"], "--placing-mm"),
        (["--task", "moon"], "moon"),
        (["--out", "aim.pdf"], "--out"),
        (["--set", "target_mm=[[900,900]]"], "target_mm"),
        (["--growth", "head_on_half_angle_deg=15,1"], "head-on-half-angle-deg"),
    ],
)
def test_bad_input_is_one_line(room, capsys, extra, named):
    arguments = ["aim", "plain_vine", "--map", str(room), "--deployments", "5000", *extra]
    if "--deployments" in extra:
        del arguments[4:6]
    assert main(arguments) == 2
    errors = capsys.readouterr().err.splitlines()
    (line,) = [line for line in errors if line.startswith("error:")]
    assert named in line
