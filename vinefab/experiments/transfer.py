"""Figure 2E: whether designs transfer to unseen maps and specialize."""

from vinefab.experiments.designs import design_from, words
from vinefab.experiments.exchange import Exchange
from vinefab.experiments.finding import Finding, Row, interval_text, percent_text
from vinefab.experiments.lab import Lab
from vinefab.experiments.setups import ENVIRONMENTS, NAMES, coverage_run
from vinefab.experiments.statistics import interval, ratio
from vinefab.report.content import Picture
from vinefab.report.figure import svg_bytes
from vinefab.report.paper_charts import Bar, grouped_bars

PAPER_GAP = {"grid": "within 2 %", "cave": "within 1.5 %"}


def transfer(lab: Lab) -> Finding:
    """Train in both environments, and test every design in both."""
    size = lab.size
    found = Exchange.of(lab, lambda home, number: coverage_run(size, home, number), size.seeds)
    return Finding(
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
        claims=(found.native_claim("grid"), found.native_claim("cave"), found.harder_claim()),
        remarks=(
            "A gap of 2 % is smaller than what so few maps can resolve: its interval says how well "
            "it is known. Training and unseen maps differ by chance too.",
        ),
        pictures=(_picture(found),),
        data={
            "training": {home: scores.tolist() for home, scores in found.training.items()},
            "unseen": {f"{a}_on_{b}": scores.tolist() for (a, b), scores in found.unseen.items()},
            "kept": dict(found.best),
            "designs": {home: found.kept_design(home) for home in ENVIRONMENTS},
        },
    )


def _rows(found: Exchange, home: str) -> list[Row]:
    name, own, native = NAMES[home], found.kept_training(home), found.kept_unseen(home, home)
    return [
        Row(what=f"{name} design", ours=words(design_from(found.kept_design(home)))),
        Row(
            what=f"{name} design on its training maps, score",
            ours=interval_text(interval(own)),
        ),
        *(
            Row(
                what=f"{name} design on unseen {NAMES[place]} maps, score",
                ours=interval_text(interval(found.kept_unseen(home, place))),
            )
            for place in ENVIRONMENTS
        ),
        Row(
            what=f"{name} design, unseen against training",
            ours=percent_text(ratio(native, own)),
            paper=PAPER_GAP[home],
        ),
        Row(
            what=f"all {name} designs, unseen against training",
            ours=percent_text(ratio(found.unseen[home, home], found.training[home])),
        ),
    ]


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
