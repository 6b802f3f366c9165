"""Figure 2E: whether designs transfer to unseen maps and specialize."""

from dataclasses import replace

import numpy as np

from vinefab.core.validation import Floats
from vinefab.core.view import Picture
from vinefab.pages.figure import svg_bytes
from vinefab.studies.claims import (
    Claim,
    ConfidenceInterval,
    PaperNumber,
    StudyResult,
    interval,
    interval_text,
    percent_text,
    ratio,
)
from vinefab.studies.paper_charts import Bar, grouped_bars
from vinefab.studies.study_jobs import JobStore, design_from, design_words
from vinefab.studies.study_runs import (
    FIRST_TRAINING,
    NAMES,
    STUDIED_ENVIRONMENTS,
    Exchange,
    coverage_run,
    maps_of,
    study_scores,
    unseen_test,
)

PAPER_GAP = {"grid": 0.02, "cave": 0.015}
"""What unseen maps cost at most in the paper, relative to the training maps."""


def transfer(store: JobStore) -> StudyResult:
    """Train in both environments, and test every design in both."""
    size = replace(store.size, unseen_maps=store.size.transfer_maps)
    found = Exchange.of(
        store,
        lambda home, number: coverage_run(size, home, number),
        size.seeds,
        unseen_maps=size.unseen_maps,
    )
    known = {home: _on_known_maps(store, found, home) for home in STUDIED_ENVIRONMENTS}
    return StudyResult(
        name="transfer",
        title="Transfer and specialization (Fig. 2E)",
        protocol=(
            f"Sensor coverage. The particle swarm ({size.population} designs, "
            f"{size.generations} generations) trained on {size.training_maps} maps of one "
            f"environment; every generation meets {size.maps_at_once} of them, drawn anew, each "
            f"from a new pose. {size.seeds} seeds, each with training maps of its own; the best on "
            f"{size.choice_maps} other maps is kept. Every "
            f"design was then tested on {size.unseen_maps} unseen maps with {size.poses} poses "
            "each, of both environments; areas are measured fast (0.1 % off in the mean square).",
            "What unseen maps cost: maps differ by more than the cost, so a design's own training "
            "maps may be easier by chance. Therefore every design was also tested on the training "
            "maps of all other seeds: the cost is what it scores on its own training maps above "
            "what the others score there, each against its own mean on the unseen maps.",
        ),
        rows=tuple(row for home in STUDIED_ENVIRONMENTS for row in _rows(found, known[home], home)),
        claims=(
            found.native_claim("grid"),
            found.native_claim("cave"),
            found.harder_claim(),
            *(_gap_claim(found, known[home], home) for home in STUDIED_ENVIRONMENTS),
        ),
        pictures=(_picture(found),),
        data={
            "training": {home: scores.tolist() for home, scores in found.training.items()},
            "known_maps": {home: scores.mean(axis=2).tolist() for home, scores in known.items()},
            "unseen": {f"{a}_on_{b}": scores.tolist() for (a, b), scores in found.unseen.items()},
            "kept": dict(found.best),
            "designs": {home: found.kept_design(home) for home in STUDIED_ENVIRONMENTS},
        },
    )


def _on_known_maps(store: JobStore, found: Exchange, home: str) -> Floats:
    """Return scores of all designs on the training maps of all of them, (runs, maps, poses)."""
    size = store.size
    worlds = maps_of(home, FIRST_TRAINING, size.seeds * size.training_maps)
    tests = [
        replace(unseen_test(size, design, home), worlds=worlds) for design in found.designs[home]
    ]
    return study_scores(store, tests)


def known_map_shares(known: Floats, unseen: Floats) -> Floats:
    """Return by what share of the mean score unseen maps cost less than known ones, by run.

    Parameters
    ----------
    known
        Scores of n runs on the training maps of all of them, those of run 0 first, shape
        (n, n * maps, poses).
    unseen
        Their scores on maps that none trained on, shape (n, maps, poses).

    Returns
    -------
    ndarray of shape (n,)
        Below 0 where a design scores more on its own training maps than others do there.
    """
    count, worth = len(known), unseen.mean(axis=(1, 2))
    above = known.mean(axis=2).reshape(count, count, -1).mean(axis=2) - worth[:, None]
    own = np.diag(above)
    others = (above.sum(axis=0) - own) / (count - 1)
    return np.asarray((others - own) / worth.mean())


def _cost(known: Floats, found: Exchange, home: str, beyond: float = 0.0) -> ConfidenceInterval:
    shares = known_map_shares(known, found.unseen[home, home])
    return interval(shares[:, None, None] - beyond)


def _rows(found: Exchange, known: Floats, home: str) -> list[PaperNumber]:
    name, own, native = NAMES[home], found.kept_training(home), found.kept_unseen(home, home)
    return [
        PaperNumber(what=f"{name} design", ours=design_words(design_from(found.kept_design(home)))),
        PaperNumber(
            what=f"{name} design on its training maps, score",
            ours=interval_text(interval(own)),
        ),
        *(
            PaperNumber(
                what=f"{name} design on unseen {NAMES[place]} maps, score",
                ours=interval_text(interval(found.kept_unseen(home, place))),
            )
            for place in STUDIED_ENVIRONMENTS
        ),
        PaperNumber(
            what=f"{name} design, unseen against training",
            ours=percent_text(ratio(native, own)),
            paper=f"within {100 * PAPER_GAP[home]:g} %",
        ),
        PaperNumber(
            what=f"all {name} designs, unseen against training",
            ours=percent_text(ratio(found.unseen[home, home], found.training[home])),
        ),
        PaperNumber(
            what=f"all {name} designs, the same without the luck of their training maps",
            ours=percent_text(_cost(known, found, home)),
            paper=f"within {100 * PAPER_GAP[home]:g} %",
        ),
    ]


def _gap_claim(found: Exchange, known: Floats, home: str) -> Claim:
    """Return the claim that unseen maps cost no more than they do in the paper."""
    least = -PAPER_GAP[home]
    return Claim(
        text=f"{NAMES[home]}: unseen maps cost less than {100 * PAPER_GAP[home]:g} % of the score "
        "(share above that)",
        tested=_cost(known, found, home, beyond=least),
        kept=ratio(found.kept_unseen(home, home), found.kept_training(home), beyond=least),
    )


def _picture(found: Exchange) -> Picture:
    groups = {
        f"trained in {NAMES[home]}": [
            Bar(label=f"tested in {NAMES[place]}", found=interval(found.kept_unseen(home, place)))
            for place in STUDIED_ENVIRONMENTS
        ]
        for home in STUDIED_ENVIRONMENTS
    }
    lines = {
        f"trained in {NAMES[home]}": float(found.kept_training(home).mean())
        for home in STUDIED_ENVIRONMENTS
    }
    return Picture(
        image=svg_bytes(grouped_bars(groups, lines, "fitness (simulated)")),
        caption="Kept designs on unseen maps of both environments (simulated), with 95 % "
        "intervals over maps; dashed: the same design on its own training maps, fresh poses.",
    )
