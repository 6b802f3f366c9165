"""Photos of joint coupons: the inflated sheet itself, drawn with angles moved by a known gain.

`python tests/observation/rendered_coupon.py` prints by how much angles are misread on 20 photos.
"""

import math
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from rendered_photo import CELL_MM, Look, Scene, render

from vinefab.fabrication.calibration.coupons import joint_designs, joint_tables
from vinefab.inflation.compensation import deployed_joint, flat_joint
from vinefab.inflation.robot import inflated_robot, joints_of
from vinefab.model.map import Pose
from vinefab.observation.observe_photo import joint_angle_deg, observe_photo
from vinefab.photos.photo import read_photo

PLY_MM, MODULUS_MPA, KPA = 0.0375, 30.0, 20.0


def gained_coupon(design, gain):
    """Return an inflated coupon of film that turns children ``gain`` times as far as simulated.

    It is the one whose flat angles are cut such that simulation brings them there.
    """
    width = design.build.widths_mm[0]
    strain = 1e-3 * KPA * width / (math.pi * PLY_MM * MODULUS_MPA)
    (joint,) = joints_of(design, hoop_strain=strain)
    flat = np.array(joint.angles_deg)
    goal = flat + gain * (np.array(deployed_joint(joint, exact=True).deployed_deg) - flat)
    cut = flat_joint(joint.with_angles(tuple(goal.tolist())), exact=True).flat.angles_deg
    turned = design
    for branch, angle_deg in zip(design.branches, cut, strict=True):
        turned = turned.with_branch(branch.name, angle_deg=angle_deg)
    return inflated_robot(turned, hoop_strain=strain)


def true_deg(found):
    """Return the angle of a pair between its children, of a single child from the trunk."""
    turns = np.degrees(found.deployed_offsets_rad)[1:]
    return float(turns[0] if len(turns) == 1 else np.ptp(turns))


class SheetScene(Scene):
    """A coupon on the table: its film is as high as the simulated sheet, its middle flat."""

    def __init__(self, world, look, robot, pose):
        super().__init__(world, _Nothing(), None, look)
        self.robot, self.pose = robot, pose
        half = self._half_height()
        radius = float(half.max())
        away = np.where(half > 0.0, np.sqrt(np.maximum(radius**2 - half**2, 0.0)), 1e6)
        slope_y, slope_x = np.gradient(half, CELL_MM)
        steep = np.maximum(np.hypot(slope_x, slope_y), 1e-9)
        down = -np.stack([slope_x, slope_y], axis=-1) / steep[..., None]
        self.tubes = [(radius, away, np.minimum(away, radius)[..., None] * down)]
        self.height = np.where(half > 0.0, radius + half, 0.0)

    def _half_height(self):
        """Return the height of the upper sheet over the seam's plane on the raster."""
        base = self.robot.layout.start_mm[0]
        turn = self.pose.heading_rad
        cos, sin = math.cos(turn), math.sin(turn)
        xy = (self.robot.positions_mm[:, :2] - base) @ np.array([[cos, sin], [-sin, cos]])
        xy += [self.pose.x_mm, self.pose.y_mm]
        half = np.zeros(self.shape)
        for corners, z in zip(
            xy[self.robot.sheet.mesh.triangles],
            self.robot.positions_mm[self.robot.sheet.mesh.triangles, 2],
            strict=True,
        ):
            low, high = corners.min(axis=0), corners.max(axis=0)
            i = slice(*np.searchsorted(self.x, [low[0], high[0]]))
            j = slice(*np.searchsorted(self.y, [low[1], high[1]]))
            if i.start >= i.stop or j.start >= j.stop:
                continue
            a, b = corners[1] - corners[0], corners[2] - corners[0]
            double = a[0] * b[1] - a[1] * b[0]
            if abs(double) < 1e-12:
                continue
            px, py = np.meshgrid(self.x[i] - corners[0, 0], self.y[j] - corners[0, 1])
            one, two = (px * b[1] - py * b[0]) / double, (py * a[0] - px * a[1]) / double
            inside = (one >= 0.0) & (two >= 0.0) & (one + two <= 1.0)
            here = z[0] + one * (z[1] - z[0]) + two * (z[2] - z[0])
            half[j, i] = np.where(
                inside, np.maximum(half[j, i], np.maximum(here, 0.05)), half[j, i]
            )
        return half


class _Nothing:
    """A deployment without branches: the sheet takes the place of its tubes."""

    class tree:  # noqa: N801
        level = np.zeros(1, dtype=int)
        width_mm = np.zeros(1)

    deployed = np.zeros(1, dtype=bool)


def photo_of(robot, width_mm, look, off=(0.0, 0.0, 0.0)):
    """Return a photo as JPEG, of a coupon laid off its pose by mm, mm and degrees."""
    world = joint_tables()[f"joints_W{width_mm:g}"]
    pose = world.starts[0].pose
    laid = Pose(
        x_mm=pose.x_mm + off[0],
        y_mm=pose.y_mm + off[1],
        heading_rad=pose.heading_rad + math.radians(off[2]),
    )
    return render(SheetScene(world, look, robot, laid))[2]


def looks(count, seed=3):
    """Return cameras and light of so many photos."""
    rng = np.random.default_rng(seed)
    return [
        Look(
            tilt_deg=float(rng.uniform(0.0, 22.0)),
            turn_deg=float(rng.uniform(0.0, 360.0)),
            roll_deg=float(rng.uniform(-25.0, 25.0)),
            distance_mm=float(rng.uniform(450.0, 900.0)),
            pixels=(1632, 1224) if k % 2 else (1280, 960),
            light_deg=(float(rng.uniform(0.0, 360.0)), float(rng.uniform(30.0, 60.0))),
            shade=float(rng.uniform(0.45, 0.7)),
            gloss=float(rng.uniform(0.2, 0.5)),
            noise=float(rng.uniform(2.0, 6.0)),
            blur_px=float(rng.uniform(0.6, 1.8)),
            jpeg=int(rng.integers(70, 93)),
            seed=k,
        )
        for k in range(count)
    ]


def misread(count):
    """Yield name, true and read angle of coupons on so many photos."""
    rng = np.random.default_rng(9)
    for number, look in enumerate(looks(count)):
        design = joint_designs()[number % 10]
        width = design.build.widths_mm[0]
        robot = gained_coupon(design, 0.6 if number % 20 < 10 else 1.2)
        off = tuple(rng.uniform(-1.0, 1.0, 3) * [0.1 * width, 0.1 * width, 3.0])
        world = joint_tables()[f"joints_W{width:g}"]
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "photo.jpg"
            path.write_bytes(photo_of(robot, width, look, off))
            seen = observe_photo(read_photo(path), world, design, world.starts[0].pose)
        yield design.name, true_deg(robot), joint_angle_deg(seen.traced, seen.film)


if __name__ == "__main__":
    errors = []
    for name, true, read in misread(20):
        errors.append(abs(read - true))
        sys.stdout.write(f"{name:13} true {true:7.2f} read {read:7.2f} off {read - true:+.2f}\n")
    sys.stdout.write(f"mean {np.mean(errors):.2f} max {np.max(errors):.2f} deg\n")
