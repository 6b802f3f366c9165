"""Doing experiments and writing them down: one page and one JSON file."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from vinefab.core.atomic import ensure_writable, write_text
from vinefab.core.jsontext import json_text
from vinefab.experiments.finding import Finding
from vinefab.experiments.lab import Lab, Tell
from vinefab.experiments.registry import EXPERIMENTS
from vinefab.experiments.size import QUICK, Size
from vinefab.optimize.result import package_versions
from vinefab.report.content import Report, Section, Table
from vinefab.report.page import page_html

PAGE, NUMBERS = "reproduction.html", "reproduction.json"
SCHEMA = "vinefab/reproduction-1"
ALL = "all"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """Experiments, done.

    Parameters
    ----------
    size
        How large they were.
    findings
        In the order of the registry.
    spent_s
        What this session took; it is in no file, so that two runs give the same files.
    """

    size: Size
    findings: tuple[Finding, ...]
    spent_s: float

    @property
    def held(self) -> tuple[int, int]:
        """How many claims hold, and how many there are."""
        claims = [claim for finding in self.findings for claim in finding.claims]
        return sum(claim.tested.held for claim in claims), len(claims)


def reproduce(
    names: Sequence[str],
    folder: Path,
    size: Size,
    *,
    workers: int = 1,
    tell: Tell = lambda _, __: None,
    announce: Callable[[str], None] = lambda _: None,
) -> Reproduction:
    """Do some experiments, and write all that the folder holds into one page and one JSON file.

    Parameters
    ----------
    names
        Which; ``all`` stands for every one.
    folder
        What is finished there is not done again.
    size
        How large; the folder must have been begun with the same.
    workers
        Processes. No number depends on it.
    tell
        Called after every job with the share of the jobs at hand that is done.
    announce
        Called with a line about each experiment that begins.

    Raises
    ------
    UnknownNameError, BadInputError, ForeignFileError, CannotWriteError
        If there is no such experiment, or the folder cannot be used.
    """
    wanted = [name for given in names for name in (EXPERIMENTS if given == ALL else [given])]
    for name in wanted:
        EXPERIMENTS[name]
    with Lab(folder, size, workers, tell) as lab:
        ensure_writable(folder / PAGE)
        ensure_writable(folder / NUMBERS)
        here = set(lab.finished()) | set(wanted)
        findings = []
        for name, experiment in EXPERIMENTS.items():
            if name in here:
                announce(name)
                findings.append(experiment(lab))
                lab.finish(name)
    done = Reproduction(size=size, findings=tuple(findings), spent_s=lab.spent_s)
    write_text(folder / NUMBERS, numbers_text(done))
    write_text(folder / PAGE, page_html(page(done)))
    return done


def numbers_text(done: Reproduction) -> str:
    """Return everything that was found as JSON: ``vinefab/reproduction-1``."""
    held, claims = done.held
    content = {
        "quick": done.size == QUICK,
        "size": asdict(done.size),
        "claims_held": held,
        "claims": claims,
        "experiments": {finding.name: finding.plain() for finding in done.findings},
        "versions": package_versions(),
    }
    return json_text(SCHEMA, content)


def page(done: Reproduction) -> Report:
    """Return the page: a summary of all claims, then every experiment."""
    held, claims = done.held
    verdict = f"{held} of {claims} orderings that the paper claims hold in these simulations."
    if done.size == QUICK:
        verdict = f"Smoke run: nothing is to be learned from these numbers. {verdict}"
    return Report(
        title="The paper's experiments, done again",
        verdict=verdict,
        tone="good" if held == claims and done.size != QUICK else "caution",
        facts=(
            ("experiments", ", ".join(finding.name for finding in done.findings)),
            ("training maps", str(done.size.training_maps)),
            ("unseen maps x poses", f"{done.size.unseen_maps} x {done.size.poses}"),
            ("search", f"{done.size.population} designs x {done.size.generations} generations"),
            ("seeds", f"{done.size.seeds}, repeats {done.size.repeats}"),
        ),
        sections=(_summary(done), *(_section(finding) for finding in done.findings)),
    )


def _summary(done: Reproduction) -> Section:
    rows = tuple(
        (finding.name, *claim.cells()) for finding in done.findings for claim in finding.claims
    )
    return Section(
        title="What the paper claims, and whether it holds",
        paragraphs=(
            "Glick et al., Branching Vine Robots for Unmapped Environments (2022). Its supplement "
            "with map generators, weights and sizes is not available; what fills these gaps is "
            "vinefab's own, so numbers may differ where orderings should not. All numbers are "
            "simulated.",
            "A claim is a difference that should be above 0. It is held when all of its 95 % "
            "bootstrap interval is, over seeds and maps, with poses kept together with their map "
            "and maps paired where both sides met the same ones. 'Undecided' means that the "
            "interval holds 0. Confidence is the share of resamples above 0. The last column "
            "is the same for the kept designs alone, which is what the paper compares: over maps "
            "only. Nothing is corrected for the number of claims.",
        ),
        tables=(
            Table(
                caption="All claims",
                headings=("experiment", *CLAIM_HEADINGS),
                rows=rows,
            ),
        ),
    )


CLAIM_HEADINGS = ("verdict", "claim", "difference [95 %]", "confidence", "kept designs only")


def _section(finding: Finding) -> Section:
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
