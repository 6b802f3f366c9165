"""The page of the experiments: a summary of all claims, what differs, then every experiment."""

from collections.abc import Sequence

from vinefab.pages.html import Report, Section, Table
from vinefab.studies.claims import CLAIM_HEADINGS, StudyResult, held, held_corrected
from vinefab.studies.study_sizes import QUICK, StudySize

SUMMARY = (
    "Glick et al., Branching Vine Robots for Unmapped Environments (2022). All numbers are "
    "simulated unless a row says measured (the paper's hardware) or computed.",
    "A claim is a difference that should be above 0. It is held when all of its 95 % bootstrap "
    "interval is, over seeds and maps, with poses kept together with their map and maps paired "
    "where both sides met the same ones. 'Undecided' means that the interval holds 0. p is "
    "two-sided, from the same resamples; confidence is the share of them above 0. The last column "
    "is the interval for the kept designs alone, which is what the paper compares: over maps only.",
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
    "time; nothing else was.",
    "Cave maps: at first 0.4 of a Cave's possible short cuts were open, and one tree reached 85 % "
    "of unseen Caves. On training maps and maps of their own it was not the search that kept trees "
    "short but long tours, and fifty plain vines reached 43 % there, not the paper's 62 %. With "
    "all short cuts open plain vines reach 62 % in 5.5 shapes on the training maps (the paper: 5), "
    "so that was taken, for every experiment, before the new Caves' test maps were met. The "
    "'ablation' keeps the old Cave.",
    "Tests: the paper compares one kept design of five on one set of 75 evaluations, and shows one "
    "map of each environment for reach. Here every claim is tested over all seeds and 25 unseen "
    "maps; small differences that the paper calls an improvement may be undecided here.",
    "Growth: a tip that meets a wall within 1 degree of head-on stops, a tip in a corner stops, "
    "and what would grow from a branch that stopped stays inside. The paper says none of this; "
    "'ablation' changes the angle and what stays inside.",
)


def study_page(findings: Sequence[StudyResult], size: StudySize) -> Report:
    """Return the page of some experiments of one size."""
    holding, claims = held(findings)
    verdict = f"{holding} of {claims} orderings that the paper claims hold in these simulations."
    if size == QUICK:
        verdict = f"Smoke run: nothing is to be learned from these numbers. {verdict}"
    return Report(
        title="The paper's experiments, done again",
        verdict=verdict,
        tone="good" if holding == claims and size != QUICK else "caution",
        facts=(
            ("experiments", ", ".join(finding.name for finding in findings)),
            ("training maps", str(size.training_maps)),
            ("unseen maps x poses", f"{size.unseen_maps} x {size.poses}"),
            ("search", f"{size.population} designs x {size.generations} generations"),
            ("seeds", f"{size.seeds}, repeats {size.repeats}"),
        ),
        sections=(
            _summary(findings),
            Section(title="What differs from the paper, and why", paragraphs=DIFFERENCES),
            *(_section(finding) for finding in findings),
        ),
    )


def _summary(findings: Sequence[StudyResult]) -> Section:
    holding, claims = held(findings)
    corrected = (
        f"{holding} of {claims} claims hold one by one; corrected for their number (Holm), "
        f"{held_corrected(findings)} still do."
    )
    rows = tuple((finding.name, *claim.cells()) for finding in findings for claim in finding.claims)
    return Section(
        title="What the paper claims, and whether it holds",
        paragraphs=(*SUMMARY, corrected),
        tables=(Table(caption="All claims", headings=("experiment", *CLAIM_HEADINGS), rows=rows),),
    )


def _section(finding: StudyResult) -> Section:
    numbers = Table(
        caption="Our numbers beside the paper's (simulated, with 95 % intervals)",
        headings=("", "here", "paper"),
        rows=tuple((row.what, row.ours, row.paper) for row in finding.rows),
    )
    claims = Table(
        caption="Orderings, tested",
        headings=CLAIM_HEADINGS,
        rows=tuple(claim.cells() for claim in finding.claims),
    )
    return Section(
        title=f"{finding.name}: {finding.title}",
        paragraphs=(*finding.protocol, *finding.remarks),
        tables=(numbers, claims) if finding.claims else (numbers,),
        pictures=finding.pictures,
    )
