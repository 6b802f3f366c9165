"""The paper's experiments: their registry, doing them, one page and one JSON file of results."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from vinefab.core.atomic import ensure_writable, write_text
from vinefab.core.plain_text import json_text
from vinefab.core.view import Answer, Block, Fact, Facts, Rows, Section
from vinefab.pages.html import page
from vinefab.search.record.identity import package_versions
from vinefab.studies import EXPERIMENTS
from vinefab.studies.claims import CLAIM_HEADINGS, StudyResult, held, held_corrected
from vinefab.studies.study_runs import QUICK_SIZE, JobStore, Progress, StudySize

STUDY_PAGE, NUMBERS = "reproduction.html", "reproduction.json"

REPRODUCTION_SCHEMA = "vinefab/reproduction-1"

ALL = "all"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """Experiments, done."""

    size: StudySize  # how large they were
    findings: tuple[StudyResult, ...]  # in the order of the registry
    spent_s: float  # what this session took; it is in no file, so that two runs give the same files

    @property
    def held(self) -> tuple[int, int]:
        """The number of claims that hold, and of all."""
        return held(self.findings)


def do_experiments(
    names: Sequence[str],
    folder: Path,
    size: StudySize,
    *,
    workers: int = 1,
    progress: Progress = lambda _, __: None,
    announce: Callable[[str], None] = lambda _: None,
) -> Reproduction:
    """Do some experiments, and write all that the folder holds into one page and one JSON file."""
    wanted = [name for given in names for name in (EXPERIMENTS if given == ALL else [given])]
    for name in wanted:
        EXPERIMENTS[name]
    with JobStore(folder, size, workers, progress) as store:
        ensure_writable(folder / STUDY_PAGE)
        ensure_writable(folder / NUMBERS)
        here = set(store.finished()) | set(wanted)
        findings = []
        for name, experiment in EXPERIMENTS.items():
            if name in here:
                announce(name)
                findings.append(experiment(store))
                store.finish(name)
    done = Reproduction(size=size, findings=tuple(findings), spent_s=store.spent_s)
    write_text(folder / NUMBERS, numbers_text(done))
    blocks = study_blocks(done.findings, done.size)
    write_text(folder / STUDY_PAGE, page("The paper's experiments, done again", blocks))
    return done


def numbers_text(done: Reproduction) -> str:
    """Return everything that was found as JSON: ``vinefab/reproduction-1``."""
    holding, claims = done.held
    content = {
        "quick": done.size == QUICK_SIZE,
        "size": asdict(done.size),
        "claims_held": holding,
        "claims_held_corrected": held_corrected(done.findings),
        "claims": claims,
        "experiments": {finding.name: finding.plain() for finding in done.findings},
        "versions": package_versions(),
    }
    return json_text(REPRODUCTION_SCHEMA, content)


SUMMARY = (
    "Glick et al., Branching Vine Robots for Unmapped Environments (2022). All numbers are "
    "simulated unless a row says measured (the paper's hardware) or computed.",
    "A claim is a difference that should be above 0. It is held when all of its 95 % interval is. "
    "Intervals are Student's, with the variance between seeds and that between maps, poses kept "
    "together with their map, and maps or seeds paired where both sides met the same ones; of "
    "differences that are 0 about 5 % are taken for real (measured by simulation). 'Undecided' "
    "means that the interval holds 0. The last column is the interval for the kept designs alone, "
    "which is what the paper compares: over maps only.",
    "Only claims of the paper are counted. 'Our threshold' marks those with a limit or a form "
    "that the paper does not give, 'calibrated' those that come out because maps were set so.",
)

DIFFERENCES = (
    "The paper's supplement with map generators, fitness weights, its evolutionary algorithm and "
    "its sizes is not available. What fills these gaps is vinefab's own and assumed: maps of 500 "
    "mm, lengths of Table 1 read as mm, sensors of 50 mm, a buffer of 40 mm, LGF as the length of "
    "the last child over the first, weights of coverage, friction 0.3. Numbers may differ for "
    "that; orderings should not.",
    "Training maps: the paper trains on 'several'. Here designs first trained on 6 fixed maps; the "
    "first full results showed Cave designs a quarter worse on unseen maps than in training, and "
    "training grew to 24 maps of which every generation meets 6, at the same number of "
    "evaluations. That change was made after a look at the final table, on the test maps of that "
    "time. Sizes, intervals and kinds of claims were set later still, after all claims had been "
    "seen at a smaller size.",
    "Cave maps: at first 0.4 of a Cave's possible short cuts were open, and one tree reached 85 % "
    "of unseen Caves. On training maps and maps of their own it was not the search that kept trees "
    "short but long tours, and fifty plain vines reached 43 % there, not the paper's 62 %. With "
    "all short cuts open plain vines reach 62 % in 5.5 shapes on the training maps (the paper: 5), "
    "so that was taken, for every experiment, before the new Caves' test maps were met. The "
    "'ablation' keeps the old Cave.",
    "Tests: the paper compares one kept design of five on one set of 75 evaluations, and shows one "
    "map of each environment for reach. Here every claim is tested over all seeds, each of which "
    "trained on separate maps, and over unseen maps; small differences that the paper calls an "
    "improvement may be undecided here.",
    "Growth: the body is a line and no pressure stops it, as in the paper. A tip that meets a wall "
    "within 1 degree of head-on stops, a tip in a corner stops, and branches of a stopped branch "
    "stay inside: the paper says none of this; 'ablation' changes the angle and the branches that "
    "stay inside.",
)


def study_blocks(findings: Sequence[StudyResult], size: StudySize) -> Iterator[Block]:
    """Yield the page of some experiments of one size."""
    holding, claims = held(findings)
    verdict = f"{holding} of {claims} orderings that the paper claims hold in these simulations."
    if size == QUICK_SIZE:
        verdict = f"Smoke run: nothing is to be learned from these numbers. {verdict}"
    yield Answer(verdict, "good" if holding == claims and size != QUICK_SIZE else "caution")
    yield from next((finding.pictures[:1] for finding in findings if finding.pictures), ())
    yield Facts(
        (
            Fact("experiments", ", ".join(finding.name for finding in findings)),
            Fact("training maps", size.training_maps),
            Fact("unseen maps x poses", f"{size.unseen_maps} x {size.poses}"),
            Fact("search", f"{size.population} designs x {size.generations} generations"),
            Fact("seeds", f"{size.seeds}, repeats {size.repeats}"),
        )
    )
    corrected = (
        f"{holding} of {claims} claims of the paper hold one by one; corrected for their number "
        f"(Holm), "
        f"{held_corrected(findings)} still do."
    )
    yield Section(
        title="What the paper claims, and whether it holds",
        paragraphs=(*SUMMARY, corrected),
        tables=(claims_table(findings),),
    )
    yield Section(title="What differs from the paper, and why", paragraphs=DIFFERENCES)
    for finding in findings:
        numbers = Rows(
            caption="Our numbers next to the paper's (simulated, with 95 % intervals)",
            headings=("", "here", "paper"),
            rows=tuple((row.what, row.ours, row.paper) for row in finding.rows),
        )
        tested = Rows(
            caption="Orderings, tested",
            headings=CLAIM_HEADINGS,
            rows=tuple(claim.cells() for claim in finding.claims),
        )
        yield Section(
            title=f"{finding.name}: {finding.title}",
            paragraphs=(*finding.protocol, *finding.remarks),
            tables=(numbers, tested) if finding.claims else (numbers,),
            pictures=finding.pictures,
        )


def claims_table(findings: Sequence[StudyResult], columns: int | None = None) -> Rows:
    """Return all claims of some experiments, or the first columns of the table."""
    return Rows(
        caption="All claims",
        headings=("experiment", *CLAIM_HEADINGS)[:columns],
        rows=tuple(
            (finding.name, *claim.cells())[:columns]
            for finding in findings
            for claim in finding.claims
        ),
    )
