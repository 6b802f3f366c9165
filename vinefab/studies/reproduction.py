"""Doing experiments and writing them down: one page and one JSON file."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from vinefab.core.atomic import ensure_writable, write_text
from vinefab.core.jsontext import json_text
from vinefab.pages.html import page_html
from vinefab.search.record.result import package_versions
from vinefab.studies.claims import StudyResult, held, held_corrected
from vinefab.studies.shipped_studies import EXPERIMENTS
from vinefab.studies.study_jobs import JobStore, Tell
from vinefab.studies.study_page import study_page
from vinefab.studies.study_sizes import QUICK, StudySize

PAGE, NUMBERS = "reproduction.html", "reproduction.json"
SCHEMA = "vinefab/reproduction-1"
ALL = "all"


@dataclass(frozen=True, slots=True, kw_only=True)
class Reproduction:
    """Experiments, done."""

    size: StudySize  # how large they were
    findings: tuple[StudyResult, ...]  # in the order of the registry
    spent_s: float  # what this session took; it is in no file, so that two runs give the same files

    @property
    def held(self) -> tuple[int, int]:
        """How many claims hold, and how many there are."""
        return held(self.findings)


def reproduce(
    names: Sequence[str],
    folder: Path,
    size: StudySize,
    *,
    workers: int = 1,
    tell: Tell = lambda _, __: None,
    announce: Callable[[str], None] = lambda _: None,
) -> Reproduction:
    """Do some experiments, and write all that the folder holds into one page and one JSON file."""
    wanted = [name for given in names for name in (EXPERIMENTS if given == ALL else [given])]
    for name in wanted:
        EXPERIMENTS[name]
    with JobStore(folder, size, workers, tell) as lab:
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
    write_text(folder / PAGE, page_html(study_page(done.findings, done.size)))
    return done


def numbers_text(done: Reproduction) -> str:
    """Return everything that was found as JSON: ``vinefab/reproduction-1``."""
    holding, claims = done.held
    content = {
        "quick": done.size == QUICK,
        "size": asdict(done.size),
        "claims_held": holding,
        "claims_held_corrected": held_corrected(done.findings),
        "claims": claims,
        "experiments": {finding.name: finding.plain() for finding in done.findings},
        "versions": package_versions(),
    }
    return json_text(SCHEMA, content)
