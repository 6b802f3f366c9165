"""What an experiment finds: numbers beside the paper's, and claims that hold or do not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from vinefab.core.statistics import holm
from vinefab.pages.html import Picture
from vinefab.studies.intervals import ConfidenceInterval

LEVEL = 0.05
CLAIM_HEADINGS = ("verdict", "claim", "difference [95 %]", "p", "confidence", "kept designs only")


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperNumber:
    """A number of ours beside the paper's."""

    what: str  # what was measured
    ours: str  # our number, in words
    paper: str = "-"  # the paper's, in words; a dash where it gives none


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """An ordering that the paper claims, as a difference that should be above 0."""

    text: str  # the claim
    tested: ConfidenceInterval  # the difference over all seeds and maps
    # the same for the kept designs alone, which is what the paper compares; None where there is no
    # such choice
    kept: ConfidenceInterval | None = None
    digits: int = 3  # decimals to print

    def plain(self) -> dict[str, Any]:
        """Return it as it stands in JSON."""
        return {
            "claim": self.text,
            "verdict": self.tested.verdict,
            "difference": _plain(self.tested),
            "kept_designs": None
            if self.kept is None
            else {"verdict": self.kept.verdict, "difference": _plain(self.kept)},
        }

    def cells(self) -> tuple[str, ...]:
        """Return it as cells of a table, under `CLAIM_HEADINGS`."""
        kept = "-"
        if self.kept is not None:
            kept = f"{interval_text(self.kept, self.digits)}, {self.kept.verdict}"
        difference = interval_text(self.tested, self.digits)
        sure = _percent(self.tested.above)
        return self.tested.verdict, self.text, difference, p_text(self.tested.p), sure, kept


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyResult:
    """An experiment, done."""

    # name, title: what it is called, and what it is about
    name: str
    title: str
    protocol: tuple[str, ...]  # how it was done, a paragraph each
    rows: tuple[PaperNumber, ...]  # numbers beside the paper's
    claims: tuple[Claim, ...] = ()  # orderings, tested
    remarks: tuple[str, ...] = ()  # where and why numbers differ from the paper's
    pictures: tuple[Picture, ...] = ()  # figures
    # the numbers behind it all, as plain values
    data: Mapping[str, Any] = field(default_factory=dict)

    def plain(self) -> dict[str, Any]:
        """Return it as it stands in JSON, without pictures."""
        return {
            "title": self.title,
            "protocol": list(self.protocol),
            "numbers": [{"what": r.what, "ours": r.ours, "paper": r.paper} for r in self.rows],
            "claims": [claim.plain() for claim in self.claims],
            "remarks": list(self.remarks),
            "data": dict(self.data),
        }


def held(findings: Sequence[StudyResult]) -> tuple[int, int]:
    """Return how many claims hold, and how many there are."""
    claims = [claim for finding in findings for claim in finding.claims]
    return sum(claim.tested.held for claim in claims), len(claims)


def held_corrected(findings: Sequence[StudyResult]) -> int:
    """Return how many claims hold still when p is corrected for their number (Holm)."""
    tested = [claim.tested for finding in findings for claim in finding.claims]
    corrected = holm([found.p for found in tested])
    return sum(found.held and p < LEVEL for found, p in zip(tested, corrected, strict=True))


def interval_text(found: ConfidenceInterval, digits: int = 3) -> str:
    """Return a number with its interval in words."""
    return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"


def percent_text(found: ConfidenceInterval) -> str:
    """Return a share with its interval as per cent."""
    return f"{100 * found.value:.1f} % [{100 * found.low:.1f}, {100 * found.high:.1f}]"


def p_text(p: float) -> str:
    """Return a p-value; a bootstrap of so many resamples tells none apart below 0.001."""
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def _percent(share: float) -> str:
    """Return a confidence; a bootstrap never makes sure."""
    return "> 99.9 %" if share > 0.999 else f"{100 * share:.1f} %"


def _plain(found: ConfidenceInterval) -> dict[str, float]:
    names = ("value", "low", "high", "above", "p")
    return {name: getattr(found, name) for name in names}
