"""Many rendered photos through `vinefab.observation`: how well what they show is recovered.

Run by `make thorough`: python tests/observation/many_photos.py [SCENES] [--quick]
"""

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from rendered_photo import Look, Scene, render

from vinefab import maps
from vinefab.core.errors import VinefabError
from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.design import Design
from vinefab.observation.beside_prediction import distance_mm
from vinefab.observation.observe_photo import PhotoSetup, observe_photo
from vinefab.photos.photo import read_photo

MOST_ERROR_MM = 2.0
WORLDS = (
    ("grid_explorer_levels", maps.grid), ("cave_explorer_levels", maps.cave),
    ("three_level_tree", maps.grid), ("plain_vine", maps.pegs), ("six_branch_anchor", maps.pegs),
    ("grid_explorer_levels", maps.pegs), ("cave_explorer_pieces_levels", maps.grid),
    ("three_level_tree", maps.pegs),
)  # fmt: skip
FILMS = ((214, 88, 40), (60, 150, 70), (240, 205, 60), (150, 70, 150))


def scene_of(number):
    """Return design, map, pose, truth, look of one scene."""
    rng = np.random.default_rng(number)
    name, environment = WORLDS[number % len(WORLDS)]
    design, world = Design.read(name), environment(seed=100 + number)
    half_angle = (1.0, 4.0, 8.0, 13.0)[number % 4]
    options = GrowthOptions.of({"head_on_half_angle_deg": half_angle, "pressure_stop": False})
    start = world.starts[0].pose
    pose = replace(start, heading_rad=start.heading_rad + float(rng.uniform(-0.25, 0.25)))
    truth = grow_on(design, Terrain.of(world), pose, options)
    hard = number % 3 == 2
    look = Look(
        tilt_deg=float(rng.uniform(0.0, 30.0)),
        turn_deg=float(rng.uniform(0.0, 360.0)),
        roll_deg=float(rng.uniform(-20.0, 20.0)),
        distance_mm=float(rng.uniform(700.0, 1200.0)) * max(world.size_mm) / 500.0,
        film=FILMS[number % len(FILMS)],
        light_deg=(float(rng.uniform(0.0, 360.0)), 25.0 if hard else 55.0),
        shade=0.3 if hard else 0.65,
        gloss=0.6 if hard else 0.3,
        noise=float(rng.uniform(2.0, 5.0)),
        jpeg=int(rng.integers(75, 93)),
        seed=number,
    )
    return design, world, pose, truth, look, half_angle


def observed(number, *, other=None, turned=None, look=None):
    """Return truth and observation of a scene; with another design, or a wrong pose, if given."""
    design, world, pose, truth, own, half_angle = scene_of(number)
    _, camera, data = render(Scene(world, truth, design.build, look or own))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"scene{number}.jpg"
        path.write_bytes(data)
        photo = read_photo(path)
    setup = PhotoSetup(obstacle_mm=own.height_mm)
    growth = {"pressure_stop": False, "head_on_half_angle_deg": half_angle}
    at = pose if turned is None else turned(pose)
    return truth, observe_photo(photo, world, other or design, at, setup, growth=growth), camera


def errors_mm(truth, seen):
    """Return the distances at equal arc lengths of all branches in both."""
    found = []
    for index, branch in enumerate(seen.traced.branches):
        mean, most = distance_mm(branch.points_mm, truth.chain_mm(index))
        if mean is not None:
            found.append((mean, most, branch.length_mm - float(truth.grown_mm[index])))
    return found


def say(line):
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def judged(number):
    """Return the figures of one scene, and print a line."""
    begin = time.process_time()
    truth, seen, _ = observed(number)
    taken = time.process_time() - begin
    errors = errors_mm(truth, seen)
    out_right = sum(
        branch.deployed == bool(truth.stop[index] != Stop.NOT_DEPLOYED)
        for index, branch in enumerate(seen.traced.branches)
    )
    stops = sum(
        branch.stop_observed == Stop(int(truth.stop[index])).label
        for index, branch in enumerate(seen.compared.branches)
    )
    orders = sum(b.order_observed == b.order_predicted for b in seen.compared.branches)
    count = len(truth.tree)
    means = np.array([error[0] for error in errors])
    mean_all = np.average(means, weights=[max(1.0, truth.grown_mm.max())] * len(means))
    wrong = [
        f"{truth.tree.ids[i]}:{Stop(int(truth.stop[i])).label}/{b.stop_observed}"
        for i, b in enumerate(seen.compared.branches)
        if b.stop_observed != Stop(int(truth.stop[i])).label
    ]
    bad = [
        f"{truth.tree.ids[i]}={m:.1f}"
        for i, b in enumerate(seen.traced.branches)
        if (m := distance_mm(b.points_mm, truth.chain_mm(i))[0]) is not None and m > 2.0
    ]
    say(
        f"{number:3d} {seen.design.name:21s} {seen.world.name:9s} {seen.rectified_by[:9]} "
        f"mean {mean_all:.2f} worst {means.max():.2f} mm, out {out_right}, stops {stops}, "
        f"contacts {orders} of {count}; film {seen.traced.film_explained:.2f} "
        f"lines {seen.traced.lines_supported:.2f} {'' if seen.film.sight.camera else 'no focal '}"
        f"{taken:.0f} s {' '.join(wrong[:9])} {' '.join(bad[:9])}"
    )
    return means.tolist(), out_right, stops, orders, count


def main(scenes):
    """Print figures over many scenes; exit 1 if the required ones are missed."""
    means, rights = [], np.zeros(4, dtype=int)
    for number in range(scenes):
        try:
            found, *counts = judged(number)
        except VinefabError as error:
            say(f"{number} REFUSED {error}")
            continue
        means += found
        rights += counts
    median, high, worst = np.median(means), np.percentile(means, 95), max(means)
    out, stops, orders, count = rights
    say(f"{len(means)} branches: median {median:.2f}, 95 % {high:.2f}, worst {worst:.2f} mm")
    say(f"deployed or not right in {out}, stop in {stops}, contacts in {orders} of {count}")
    return 0 if high < MOST_ERROR_MM else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 24))
