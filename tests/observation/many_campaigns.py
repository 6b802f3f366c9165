"""How often the fit's interval holds the true half-angle, from photos that are not kind.

A campaign is some photos of robots whose tips all stop at one half-angle; every photo is rendered,
observed and written, and the files are fitted together.

Run: python tests/observation/many_campaigns.py [CAMPAIGNS] [--photos N] [--jobs N] [--out FILE]
"""

import argparse
import json
import os
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from many_unkind import FORK, WORLDS, observed, say

from vinefab.core.errors import VinefabError
from vinefab.observation.contact_fit import fit_photos
from vinefab.observation.observed_contacts import read_observations

FORKS = [place for place, (design, _) in enumerate(WORLDS) if design is FORK]
LEAST_SHARE = 0.9


def half_angle_of(campaign):
    return float(np.random.default_rng(500 + campaign).uniform(1.0, 20.0))


def number_of(campaign, photo, photos):
    """Return the number of a scene with the small design."""
    place = campaign * photos + photo
    return (
        1000 + len(WORLDS) * (place // len(FORKS)) + FORKS[place % len(FORKS)] - 1000 % len(WORLDS)
    )


def written(task):
    """Return the numbers of one photo's observation; None where it is refused."""
    campaign, photo, photos = task
    try:
        _, seen = observed(number_of(campaign, photo, photos), half_angle_of(campaign))
    except VinefabError as error:
        return task, str(error), None
    content = seen.numbers
    for branch in content["branches"]:
        branch["points_mm"] = branch["points_mm"][:2]  # whole shapes are not fitted here
    return task, None, content


def fitted(contents):
    """Return the fit of several observations."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{place}.json" for place in range(len(contents))]
        for place, (path, content) in enumerate(zip(paths, contents, strict=True)):
            named = {**content, "photo": f"photo{place}", "map": "-", "design": "-"}
            path.write_text(json.dumps(named))
        return fit_photos(read_observations(paths))


def main():
    """Print coverage; exit 1 if intervals hold the truth too seldom."""
    parser = argparse.ArgumentParser()
    parser.add_argument("campaigns", type=int, nargs="?", default=200)
    parser.add_argument("--photos", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    tasks = [(c, p, given.photos) for c in range(given.campaigns) for p in range(given.photos)]
    contents = {c: [] for c in range(given.campaigns)}
    refused = 0
    with ProcessPoolExecutor(given.jobs) as pool:
        for task, error, content in pool.map(written, tasks, chunksize=4):
            refused += error is not None
            if content is not None:
                contents[task[0]].append(content)
    rows, held, without = [], 0, 0
    for campaign, some in contents.items():
        truth = half_angle_of(campaign)
        try:
            found = fitted(some).contacts.head_on_half_angle_deg if some else None
        except VinefabError:
            found = None
        if found is None:
            without += 1
            continue
        held += found.low <= truth <= found.high
        rows.append({"campaign": campaign, "truth": round(truth, 2), "low": found.low,
                     "high": found.high, "side": found.side, "contacts": found.count,
                     "holds": found.low <= truth <= found.high})  # fmt: skip
        say(json.dumps(rows[-1]))
    summary = {
        "campaigns": len(rows), "photos_each": given.photos, "refused_photos": refused,
        "without_contacts": without, "held": held,
        "share": held / max(1, len(rows)),
        "two_sided": sum(row["side"] == "both" for row in rows),
        "median_width_deg": float(np.median([row["high"] - row["low"] for row in rows])),
    }  # fmt: skip
    say(json.dumps(summary, indent=1))
    if given.out:
        kept = {"summary": summary, "campaigns": rows, "contents": contents}
        given.out.write_text(json.dumps(kept))
    return 0 if held >= LEAST_SHARE * len(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
