"""Forty photos that are not kind, through `vinefab.observation`: what is claimed, and what is true.

Run by `make thorough`: python tests/observation/many_unkind.py [PHOTOS] [--jobs N] [--out FILE]
"""

import argparse
import json
import math
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from unkind_photo import Body, Unkind, grow_bent, photographed

from vinefab import maps
from vinefab.core.errors import VinefabError
from vinefab.model.design import Build, Design, Level
from vinefab.observation.observe_photo import PhotoSetup, observe_photo
from vinefab.photos.photo import read_photo

MOST_TIP_MM = 8.0
SAME_PLACE_MM = 8.0
FORK = Design(
    name="fork",
    trunk_length_mm=120.0,
    levels=(Level.of(branches=3, length_mm=130.0, angle_deg=100.0),
            Level.of(branches=2, length_mm=90.0, angle_deg=70.0)),
    build=Build(widths_mm=(22.0, 17.0, 13.0), fillet_mm=(2.0, 2.0), tail_mm=20.0, pressure_kpa=0.0),
)  # fmt: skip
WORLDS = (
    (FORK, maps.grid), (FORK, maps.pegs), ("grid_explorer_levels", maps.grid), (FORK, maps.grid),
    ("three_level_tree", maps.pegs), (FORK, maps.grid), ("six_branch_anchor", maps.pegs),
    ("cave_explorer_levels", maps.cave),
)  # fmt: skip
FILMS = ((214, 88, 40), (60, 150, 70), (240, 205, 60), (150, 70, 150), (60, 110, 215))
BLOCKS = ((90, 110, 140), (120, 95, 70), (70, 70, 72))


def scene_of(number, half_angle_deg=None):
    """Return design, map, pose, the true branches and the photo of one scene."""
    rng = np.random.default_rng(90_000 + number)
    given, environment = WORLDS[number % len(WORLDS)]
    design = given if isinstance(given, Design) else Design.read(given)
    world = environment(seed=300 + number)
    start = world.starts[0].pose
    pose = replace(start, heading_rad=start.heading_rad + float(rng.uniform(-0.25, 0.25)))
    drawn = float(rng.choice([2.0, 6.0, 12.0, 20.0]))
    body = Body(
        half_angle_deg=drawn if half_angle_deg is None else half_angle_deg,
        bend_per_mm=1.0 / float(rng.uniform(400.0, 900.0)),
        joint_deg=float(rng.uniform(4.0, 7.0)),
        absent=float(rng.choice([0.0, 0.1, 0.2])),
    )
    truth = grow_bent(design, world, pose, body, rng)
    look = Unkind(
        tilt_deg=float(rng.uniform(0.0, 25.0)),
        turn_deg=float(rng.uniform(0.0, 360.0)),
        roll_deg=float(rng.uniform(-20.0, 20.0)),
        distance_mm=float(rng.uniform(800.0, 1300.0)) * max(world.size_mm) / 500.0,
        film=FILMS[number % len(FILMS)],
        block=BLOCKS[number % len(BLOCKS)],
        height_mm=float(rng.choice([15.0, 30.0])),
        opacity=float(rng.uniform(0.4, 0.85)),
        wrinkle=float(rng.uniform(0.02, 0.07)),
        seam_mm=(0.4, 2.0)[number // 2 % 2],
        light_deg=(float(rng.uniform(0.0, 360.0)), float(rng.uniform(22.0, 55.0))),
        shade=float(rng.uniform(0.12, 0.5)),
        wave_mm=float(rng.choice([0.0, 1.0, 2.0])),
        bend=float(rng.choice([0.0, -0.01, 0.01, 0.02])),
        blur_px=float(rng.uniform(0.6, 1.4)),
        noise=float(rng.uniform(2.0, 5.0)),
        jpeg=int(rng.integers(70, 93)),
        seed=number,
    )
    return design, world, pose, truth, look, photographed(world, truth, look)


def observed(number, half_angle_deg=None):
    """Return the true branches and the observation of a scene."""
    design, world, pose, truth, look, data = scene_of(number, half_angle_deg)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"unkind{number}.jpg"
        path.write_bytes(data)
        photo = read_photo(path)
    setup = PhotoSetup(obstacle_mm=look.height_mm)
    return truth, observe_photo(photo, world, design, pose, setup, growth={"pressure_stop": False})


def flagged(branch, seen):
    """Tell whether an observation says itself that a branch is uncertain."""
    doubts = getattr(branch, "doubts", None)
    if doubts is not None:
        return bool(doubts)
    return any(branch.id in caution.split(": ")[-1].split(", ") for caution in seen.cautions)


def paired(contact, true):
    """Return what is claimed of a contact beside the true one at its place; None if unclear."""
    if contact.outcome == "unclear":
        return None
    seen = [contact.outcome, contact.angle_from_normal_deg, contact.angle_error_deg]
    away = [np.hypot(contact.x_mm - t[0], contact.y_mm - t[1]) for t in true.contacts]
    if not away or min(away) > 2.0 * SAME_PLACE_MM:
        return [*seen, None, None]
    nearest = true.contacts[int(np.argmin(away))]
    return [*seen, nearest[3], float(nearest[2])]


def judged(number):
    """Return what is claimed of one photo, against the truth."""
    begin = time.process_time()
    row = {"photo": number}
    try:
        truth, seen = observed(number)
    except VinefabError as error:
        return {**row, "refused": str(error)}
    branches = []
    for true, branch in zip(truth, seen.compared.branches, strict=True):
        out = len(true.points_mm) > 0
        tip_mm = math.inf
        if out and branch.deployed_observed:
            tip_mm = float(np.hypot(*(branch.traced.points_mm[-1] - true.points_mm[-1])))
        elif not out and not branch.deployed_observed:
            tip_mm = 0.0
        stopped = [np.array(c[:2]) for c in true.contacts if c[3] == "stopped"]
        claims = [c for c in branch.contacts if c.outcome == "stopped"]
        false_claims = [
            c for c in claims
            if true.stop not in ("head_on", "corner")
            or np.hypot(*(true.points_mm[-1] - (c.x_mm, c.y_mm))) > SAME_PLACE_MM + true.radius_mm
        ]  # fmt: skip
        claims_stop = branch.stop_observed in ("head_on", "corner")
        is_false = bool(false_claims) or (claims_stop and true.stop not in ("head_on", "corner"))
        is_false |= claims_stop and tip_mm > SAME_PLACE_MM
        branches.append({
            "id": branch.id, "true": true.stop, "seen": branch.stop_observed,
            "tip_mm": round(tip_mm, 1) if math.isfinite(tip_mm) else None,
            "flagged": flagged(branch, seen), "doubts": list(getattr(branch, "doubts", ())),
            "false_stop": is_false, "claims": len(claims), "stops": len(stopped),
            "pairs": [pair for c in branch.contacts if (pair := paired(c, true)) is not None],
            "true_angles": [round(float(t[2]), 2) for t in true.contacts],
            "contacts": sum(c.outcome != "unclear" for c in branch.contacts),
        })  # fmt: skip
    return {
        **row, "design": seen.design.name, "map": seen.world.name, "verdict": bool(seen.fits),
        "film": round(seen.traced.film_explained, 3),
        "lines": round(seen.traced.lines_supported, 3),
        "cpu_s": round(time.process_time() - begin, 1), "branches": branches,
        "cautions": list(seen.cautions),
    }  # fmt: skip


def summary(rows):
    """Return the figures that are asked for."""
    read = [row for row in rows if "refused" not in row]
    with_verdict = [row for row in read if row["verdict"]]
    every = [b for row in read for b in row["branches"]]
    judged_ = [b for row in with_verdict for b in row["branches"]]
    far = [
        b
        for b in judged_
        if not b["flagged"] and (b["tip_mm"] is None or b["tip_mm"] > MOST_TIP_MM)
    ]
    sure = [b for b in judged_ if not b["flagged"]]
    stops = [b for b in judged_ if b["stops"]]
    return {
        "photos": len(rows),
        "refused": len(rows) - len(read),
        "with_verdict": len(with_verdict),
        "photos_with_false_stop": sum(
            any(b["false_stop"] for b in row["branches"]) for row in with_verdict
        ),
        "false_stops": sum(b["false_stop"] for b in judged_),
        "branches": len(every),
        "of_photos_with_verdict": len(judged_),
        "not_flagged": len(sure),
        "far_and_not_flagged": len(far),
        "true_stops": len(stops),
        "stops_claimed": sum(bool(b["claims"]) for b in judged_),
        "contacts_claimed": sum(b["contacts"] for b in judged_),
        "contacts_that_were_none": sum(p[3] is None for b in judged_ for p in b["pairs"]),
        "contacts_of_wrong_outcome": sum(
            p[3] is not None and p[0] != p[3] for b in judged_ for p in b["pairs"]
        ),
        "angle_off_over_error_rms": rms([
            (p[1] - p[4]) / p[2] for b in judged_ for p in b["pairs"] if p[3] is not None
        ]),
    }  # fmt: skip


def is_far(branch):
    return branch["tip_mm"] is None or branch["tip_mm"] > MOST_TIP_MM


def rms(values):
    return round(float(np.sqrt(np.mean(np.square(values)))), 2) if len(values) else None


def say(line):
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def said(row):
    """Return one line about a photo."""
    if "refused" in row:
        return f"{row['photo']:3d} REFUSED {row['refused']}"
    wrong = [
        f"{b['id']}:{b['true']}/{b['seen']}={b['tip_mm']}{'?' if b['flagged'] else ''}"
        f"{'!' if b['false_stop'] else ''}"
        for b in row["branches"]
        if b["false_stop"] or (is_far(b) and not b["flagged"])
    ]  # fmt: skip
    sure = sum(not b["flagged"] for b in row["branches"])
    verdict = "verdict" if row["verdict"] else "none   "
    return (
        f"{row['photo']:3d} {row['design']:17s} {row['map']:9s} {verdict} film {row['film']:.2f} "
        f"lines {row['lines']:.2f} sure {sure} of {len(row['branches'])} {row['cpu_s']} s "
        f"{' '.join(wrong)}"
    )


def main():
    """Print figures over many photos; exit 1 if what is asked for is missed."""
    parser = argparse.ArgumentParser()
    parser.add_argument("photos", type=int, nargs="?", default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    numbers = range(given.first, given.first + given.photos)
    rows = []
    if given.jobs == 1:
        for number in numbers:
            rows.append(judged(number))
            say(said(rows[-1]))
    else:
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        with ProcessPoolExecutor(given.jobs) as pool:
            for row in pool.map(judged, numbers):
                rows.append(row)
                say(said(row))
    found = summary(rows)
    say(json.dumps(found, indent=1))
    if given.out:
        given.out.write_text(json.dumps({"summary": found, "photos": rows}, indent=1))
    # Film that comes back along its own trunk hides all of a child.
    hidden = 0.01 * found["not_flagged"]
    return 1 if found["false_stops"] or found["far_and_not_flagged"] > hidden else 0


if __name__ == "__main__":
    sys.exit(main())
