"""How often the fit's interval holds the true half-angle, with contacts as unkind photos give them.

A campaign is some photos of robots whose tips all stop at one half-angle. Photos take seconds each,
so campaigns are simulated at the level of contacts: angles, errors and what goes unseen are drawn
from what `many_unkind.py` found on its photos (its --out file), where the truth is known.

Run: python tests/observation/many_campaigns.py UNKIND.json [CAMPAIGNS] [--photos N]
"""

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from vinefab.observation.contact_fit import fit_threshold

LEAST_SHARE = 0.9


class Pool:
    """Contacts of photos with a verdict, beside the true ones."""

    def __init__(self, content):
        branches = [b for p in content["photos"] if p.get("verdict") for b in p["branches"]]
        pairs = [pair for branch in branches for pair in branch["pairs"]]
        matched = [pair for pair in pairs if pair[3] is not None]
        self.true_deg = np.array([angle for b in branches for angle in b["true_angles"]])
        self.none = [pair for pair in pairs if pair[3] is None]
        self.wrong = sum(pair[0] != pair[3] for pair in matched) / max(1, len(matched))
        self.of = {
            outcome: np.array([(p[1] - p[4], p[2]) for p in matched if p[3] == outcome])
            for outcome in ("stopped", "slid")
        }
        stops = sum(branch["stops"] for branch in branches)
        self.seen = {
            "stopped": len(self.of["stopped"]) / max(1, stops),
            "slid": len(self.of["slid"]) / max(1, len(self.true_deg) - stops),
        }
        self.each = len(self.true_deg) / max(
            1, sum(bool(p.get("verdict")) for p in content["photos"])
        )

    def photo(self, half_angle_deg, rng):
        """Return angles, whether tips stopped, and errors, as one photo would give them."""
        rows = []
        for angle in rng.choice(self.true_deg, max(1, rng.poisson(self.each))):
            outcome = "stopped" if angle <= half_angle_deg else "slid"
            if rng.random() > self.seen[outcome]:
                continue
            off, error = self.of[outcome][rng.integers(len(self.of[outcome]))]
            claimed = (outcome == "stopped") != (rng.random() < self.wrong)
            rows.append((min(90.0, abs(angle + off)), claimed, error))
        # Contacts that were none come as often as they came there.
        if self.none and rng.random() < len(self.none) / max(1, len(self.true_deg)) * self.each:
            outcome, angle, error, *_ = self.none[rng.integers(len(self.none))]
            rows.append((angle, outcome == "stopped", error))
        return rows


def main():
    """Print coverage; exit 1 if intervals hold the truth too seldom."""
    parser = argparse.ArgumentParser()
    parser.add_argument("unkind", type=Path)
    parser.add_argument("campaigns", type=int, nargs="?", default=200)
    parser.add_argument("--photos", type=int, default=5)
    given = parser.parse_args()
    pool = Pool(json.loads(given.unkind.read_text()))
    rows, without = [], 0
    for campaign in range(given.campaigns):
        rng = np.random.default_rng(500 + campaign)
        truth = float(rng.uniform(1.0, 20.0))
        seen = [(*row, photo) for photo in range(given.photos) for row in pool.photo(truth, rng)]
        if not seen:
            without += 1
            continue
        angles, stopped, errors, photos = zip(*seen, strict=True)
        fit = fit_threshold(angles, stopped, photos, errors)
        rows.append((fit.low_deg <= truth <= fit.high_deg, fit.side, fit.high_deg - fit.low_deg))
    held = sum(row[0] for row in rows)
    found = {
        "campaigns": len(rows),
        "photos_each": given.photos,
        "without_contacts": without,
        "contacts_in_pool": {name: len(some) for name, some in pool.of.items()},
        "seen": pool.seen,
        "held": held,
        "share": held / max(1, len(rows)),
        "two_sided": sum(row[1] == "both" for row in rows),
        "median_width_deg": float(np.median([row[2] for row in rows])),
    }
    sys.stdout.write(f"{json.dumps(found, indent=1)}\n")
    return 0 if held >= LEAST_SHARE * len(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
