"""Figure 2E: whether designs transfer to unseen maps and specialize."""

from vinefab.pages.figure import svg_bytes
from vinefab.pages.html import Picture
from vinefab.studies.claims import (
    Claim,
    PaperNumber,
    StudyResult,
    interval,
    interval_text,
    percent_text,
    ratio,
)
from vinefab.studies.paper_charts import Bar, grouped_bars
from vinefab.studies.study_jobs import JobStore, design_from, design_words
from vinefab.studies.study_runs import ENVIRONMENTS, NAMES, Exchange, coverage_run

PAPER_GAP = {"grid": 0.02, "cave": 0.015}
"""What unseen maps cost at most in the paper, relative to the training maps."""


def transfer(store: JobStore) -> StudyResult:
    """Train in both environments, and test every design in both."""
    size = store.size
    found = Exchange.of(store, lambda home, number: coverage_run(size, home, number), size.seeds)
    return StudyResult(
        name="transfer",
        title="Transfer and specialization (Fig. 2E)",
        protocol=(
            f"Sensor coverage. The particle swarm ({size.population} designs, "
            f"{size.generations} generations) trained on {size.training_maps} maps of one "
            f"environment; every generation meets {size.maps_at_once} of them, drawn anew, each "
            f"from a new pose. {size.seeds} seeds; the best "
            "by its score on fresh poses on the training maps is kept, as in the paper. Every "
            f"design was then tested on {size.unseen_maps} unseen maps with {size.poses} poses "
            "each, of both environments; areas are exact.",
        ),
        rows=tuple(row for home in ENVIRONMENTS for row in _rows(found, home)),
        claims=(
            found.native_claim("grid"),
            found.native_claim("cave"),
            found.harder_claim(),
            *(_gap_claim(found, home) for home in ENVIRONMENTS),
        ),
        remarks=(
            "A gap of 2 % is smaller than what so few maps can resolve: its interval says how well "
            f"it is known. The {size.training_maps} training maps are easier or harder than others "
            "by chance, which more unseen maps would not tell from a gap.",
        ),
        pictures=(_picture(found),),
        data={
            "training": {home: scores.tolist() for home, scores in found.training.items()},
            "unseen": {f"{a}_on_{b}": scores.tolist() for (a, b), scores in found.unseen.items()},
            "kept": dict(found.best),
            "designs": {home: found.kept_design(home) for home in ENVIRONMENTS},
        },
    )


def _rows(found: Exchange, home: str) -> list[PaperNumber]:
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
            for place in ENVIRONMENTS
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
    ]


def _gap_claim(found: Exchange, home: str) -> Claim:
    """Return the claim that unseen maps cost no more than they do in the paper."""
    least = -PAPER_GAP[home]
    return Claim(
        text=f"{NAMES[home]}: unseen maps cost less than {100 * PAPER_GAP[home]:g} % of the score "
        "(share above that)",
        tested=ratio(found.unseen[home, home], found.training[home], beyond=least),
        kept=ratio(found.kept_unseen(home, home), found.kept_training(home), beyond=least),
    )


def _picture(found: Exchange) -> Picture:
    groups = {
        f"trained in {NAMES[home]}": [
            Bar(label=f"tested in {NAMES[place]}", found=interval(found.kept_unseen(home, place)))
            for place in ENVIRONMENTS
        ]
        for home in ENVIRONMENTS
    }
    lines = {
        f"trained in {NAMES[home]}": float(found.kept_training(home).mean())
        for home in ENVIRONMENTS
    }
    return Picture(
        image=svg_bytes(grouped_bars(groups, lines, "fitness (simulated)")),
        caption="Kept designs on unseen maps of both environments (simulated), with 95 % bootstrap "
        "intervals over maps; dashed: the same design on its own training maps, fresh poses.",
        wide=True,
    )
