"""The page of a run that has ended, with its pictures beside it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.errors import VinefabError
from vinefab.core.view import (
    Answer,
    Block,
    Fact,
    Facts,
    Number,
    Picture,
    Rows,
    Section,
)
from vinefab.fabrication.checking import check_design
from vinefab.fabrication.findings_picture import findings_picture
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.rules.catalog import RULES, by_rule, changed_limits
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.finding import CheckReport, Finding, Severity
from vinefab.model.map import Map
from vinefab.pages.html import page
from vinefab.pages.map_view import STOP_WORDS
from vinefab.pages.page_files import page_svg
from vinefab.prediction.deployment_sections import TOO_FINE, deployment_picture, stop_table
from vinefab.prediction.family_deployments import PreparedFamily
from vinefab.prediction.pictures import cost_chart
from vinefab.prediction.prediction_width import COST_CAPTION
from vinefab.prediction.run_winner import EndedRun
from vinefab.search.record.generations import curve_of
from vinefab.search.record.result import angles_standing
from vinefab.search.run import FRESH_MAPS, chooses_on_fresh_maps
from vinefab.search.run_pages import PAGE_NAME, run_facts, search_section
from vinefab.search.settings import RunSettings, run_task
from vinefab.search.space import Space
from vinefab.tasks.targets import touched_targets

PICTURES = "pictures"
"""The folder beside the page with its pictures."""


MOST_TRAINING_SHOWN = 3
"""Training maps that the winner is drawn on."""

NEAR = 0.1
"""A rule is close to its limit where a limit stricter by this share would be broken."""

EDGE = 0.01
"""A winner touches a bound that it is nearer to than this share of the range."""


def write_run_page(folder: Path, run: EndedRun, *, force: bool = False) -> Path:
    """Write the page of a run that has ended, and its pictures beside it."""
    blocks = list(run_blocks(run))
    pictures = [block for block in blocks if isinstance(block, Picture)]
    pictures += [one for block in blocks if isinstance(block, Section) for one in block.pictures]
    for picture in pictures:
        write_bytes(folder / PICTURES / picture.file_name, picture.drawn, force=force)
    title = f"{run.settings.name}: the best design found"
    return write_text(folder / PAGE_NAME, page(title, blocks), force=force)


def run_blocks(run: EndedRun) -> Iterator[Block]:
    """Yield the page of a run that has ended, the answer and a picture first."""
    checked = _checked(run)
    training, unseen = run.families()
    elsewhere = run.grown(unseen)
    pictures, sections = _shown(run, training, unseen, elsewhere)
    # The winner is drawn on maps first, and flat with the rules below.
    view = [one for one in run.result.view() if not isinstance(one, Picture)]
    answers: list[Block] = [one for one in view if isinstance(one, Answer)]
    lead: list[Block] = [one for one in view if isinstance(one, Facts) and one.lead]
    yield from (*answers, *pictures, *lead)
    if run.result.prediction:
        yield _cost_picture(run)
    above = {id(one) for one in (*answers, *lead)}
    yield from (one for one in view if id(one) not in above)
    chosen = Fact("winner chosen", f"among the finalists by fitness {_chosen_by(run.settings)}")
    yield Facts((*run_facts(run.settings), chosen))
    yield _sheet_section(run, checked)
    yield from sections
    yield from _width_sections(run)
    yield _limit_section(run, checked, unseen.label, elsewhere)
    yield _found_section(run)
    yield _files_section(run)


def _cost_picture(run: EndedRun) -> Picture:
    """Return what contacts cost the winner's score, as one picture."""
    found = run.result.prediction
    unseen, name = found["unseen"], f"{found.get('title', found['task'])} score, simulated"
    score = [unseen["score"][end] for end in ("mean", "low", "high")]
    low, *_, high = found["head_on_half_angles_deg"]

    def row(words: str, values: Sequence[Mapping[str, float]]) -> tuple[str, list[float]]:
        means = [value["mean"] for value in values]
        return f"{words}: {means[0]:.3f} to {means[-1]:.3f}", means

    words = {
        "branch_contact": "branches pass, or stop at each other",
        "emergence": "children come out, 1 to 0.9",
    }
    rows = [
        row(f"tips stop within {low:g} to {high:g} deg", unseen["over_contacts"]),
        *(row(words[rule["option"]], rule["unseen"]) for rule in found.get("rules", ())),
    ]
    predicted = [value for value in score if value is not None]
    return Picture(
        image=page_svg(cost_chart(name, predicted, rows)), caption=COST_CAPTION, file="contacts"
    )


def _chosen_by(settings: RunSettings) -> str:
    """Return where the fitness of finalists comes from, as a phrase."""
    if settings.evaluation.finalists_by == "contact_range":
        return "over the range of contacts"
    if chooses_on_fresh_maps(settings):
        return f"on {FRESH_MAPS} other maps that the search did not see"
    return "on these poses"


def _shown(
    run: EndedRun,
    training: PreparedFamily,
    unseen: PreparedFamily,
    elsewhere: Sequence[Deployment],
) -> tuple[tuple[Picture, ...], tuple[Section, ...]]:
    """Return the winner on unseen maps, worst, median and best, and the rest of its deployments."""
    kept = min(len(training.maps), MOST_TRAINING_SHOWN)
    grown = run.grown(training)
    places = unseen.launches().terrain.tolist()
    pictures = tuple(
        _drawn(run, name, unseen.maps[places[index]].world, elsewhere[index], words)
        for index, name, words in _typical(run, len(places))
    )
    on_training = tuple(
        _drawn(run, f"training_{index + 1}", training.maps[index].world, grown[index], "its start")
        for index in range(kept)
    )
    # A run with maps of its own has no unseen ones.
    where = unseen.label if unseen.label.startswith("other poses") else "unseen maps"
    ended = stop_table(unseen.label, elsewhere)
    return pictures, (
        Section(title="The winner on its training maps", pictures=on_training, folded=True),
        Section(title=f"How branches end on {where}", tables=(ended,), folded=True),
    )


def _typical(run: EndedRun, count: int) -> list[tuple[int, str, str]]:
    """Return number, name and words of the unseen deployments to draw: worst, median, best."""
    scores = run.result.prediction.get("unseen", {}).get("scores", [])
    if len(scores) != count:
        return [(0, "unseen_1", "the first pose")]
    order = np.argsort(scores, kind="stable").tolist()
    chosen = {order[0]: "worst", order[len(order) // 2]: "median", order[-1]: "best"}
    return [
        (index, f"unseen_{name}", f"{name} of {count}, {scores[index]:.3f}")
        for index, name in chosen.items()
    ]


def _drawn(run: EndedRun, name: str, world: Map, deployment: Deployment, words: str) -> Picture:
    touched = touched_targets([(deployment, world)], run_task(run.settings))
    image = deployment_picture(
        run.design, world, deployment, run.growth, whole=True, touched=touched
    )
    return Picture(image=image, caption=f"{world.name}, {words} (simulated).", file=name)


_KNOWN = {
    True: "Whether a tip that meets a wall slides on or stops there is not known,",
    False: "Whether a tip that meets a wall slides on or stops there is known from photos only as "
    "far as the range says,",
}


def _width_sections(run: EndedRun) -> tuple[Section, ...]:
    """Return how wide the prediction is; nothing where nothing was predicted."""
    found = run.result.prediction
    if not found:
        return ()
    standing = angles_standing(found)
    signed = partial(Number, form="+.3f")
    placed = Rows(
        caption=f"Change of the mean {found.get('title', found['task'])} score on "
        f"{found['unseen']['label']} when the body is placed "
        "elsewhere than meant, with its 95 % interval over maps (simulated)",
        headings=("placed off by", "change", "95 % interval", "deployments"),
        rows=tuple(
            (
                f"{row['knob']} {row['step']:+g} {row['unit']}",
                signed(row["change"]),
                "-"
                if row["low"] is None
                else f"{row['low']:+.3f} to {row['high']:+.3f}; {row.get('over', '')}",
                row["deployments"],
            )
            for row in found["placed_off"]
        ),
    )
    words = (
        f"{_KNOWN[standing == 'assumed']} nor how well a "
        "body is placed: what a robot will do lies in these ranges. Positive headings turn the "
        "base to its left, positive positions move it to its left; places without room for the "
        "trunk are left out."
    )
    section = Section(
        title="How wide the score is", paragraphs=(words,), tables=(placed,), folded=True
    )
    return (section,)


def _checked(run: EndedRun) -> CheckReport | str:
    """Return the report of all rules on the winner, or why there is none."""
    try:
        return check_design(run.design, run.profile())
    except VinefabError as error:
        return str(error)


def _sheet_section(run: EndedRun, checked: CheckReport | str) -> Section:
    """Return the flat robot with the findings at their places."""
    title = "The flat sheet and what the rules say"
    if isinstance(checked, str):
        return Section(title=title, paragraphs=(f"Not checked: {checked}.",))
    asked = "" if run.settings.evaluation.fabricable else " The search did not ask for it."
    words = (f"{checked.verdict}; recipe {run.profile().recipe.name}.{asked}",)
    if run.design.branch_count > TOO_FINE:
        return Section(
            title=title,
            paragraphs=(*words, "Too many branches to be drawn here: vinefab check --svg does."),
        )
    image = page_svg(findings_picture(run.design, run.profile(), checked))
    caption = "The body with its seam, as it is cut, and every finding at its place (computed)."
    picture = Picture(image=image, caption=caption, file="sheet")
    return Section(title=title, paragraphs=words, pictures=(picture,))


def _limit_section(
    run: EndedRun, checked: CheckReport | str, where: str, elsewhere: Sequence[Deployment]
) -> Section:
    """Return what limits the winner: walls and pressure, rules, bounds of the space."""
    tables = [
        Rows(
            caption=f"Rules that the winner breaks, or would if limits were {100 * NEAR:.0f} % "
            "stricter (computed)",
            headings=("rule", "what", "measured", "limit", "branches"),
            rows=() if isinstance(checked, str) else _rule_rows(run, checked),
        ),
        Rows(
            caption="Variables of the search in which the winner lies at an end of its range",
            headings=("variable", "winner", "end of its range"),
            rows=tuple(_bound_rows(run)),
        ),
    ]
    stops = np.concatenate([deployment.stop for deployment in elsewhere])
    shares = [
        f"{100 * share:.0f} % {STOP_WORDS[stop]}"
        for stop in Stop
        if (share := float(np.mean(stops == stop))) > 0.0
    ]
    empty = [table.caption for table in tables if not table.rows]
    kept = Space(run.settings.space, run.settings.build).limits_text(run.design)
    return Section(
        title="What limits it",
        paragraphs=(
            f"How its branches end on {where} (simulated): {', '.join(shares)}.",
            *([f"Limits of the space: {kept} (planned)."] if kept else []),
            *_bed_words(run, checked),
            *(f"{caption}: none." for caption in empty),
        ),
        tables=tuple(table for table in tables if table.rows),
        folded=True,
    )


def _bed_words(run: EndedRun, checked: CheckReport | str) -> tuple[str, ...]:
    """Return how much of the bed the flat robot takes, where it is nearly all of a side."""
    if isinstance(checked, str) or run.design.branch_count > TOO_FINE:
        return ()
    machine = run.profile().machine
    facts = laser_job(run.design, run.profile()).facts
    if "box_width_mm" not in facts:
        return ()  # in tiles, as it is larger than the bed
    wide, high = (float(str(facts[f"box_{side}_mm"])) for side in ("width", "height"))
    most_wide, most_high = machine.usable_mm
    if max(wide / most_wide, high / most_high) < 1.0 - NEAR:
        return ()
    return (
        f"The bed of {machine.name}: the flat robot takes {wide:.0f} x {high:.0f} mm of its "
        f"{most_wide:g} x {most_high:g} mm (computed). A larger bed, a shorter tail "
        "(build.tail_mm) or pieces (build.pieces) leave more room.",
    )


def _rule_rows(run: EndedRun, checked: CheckReport) -> tuple[tuple[str, ...], ...]:
    """Return the findings of the rules, and of the same rules a little stricter."""
    found = {finding.rule: (finding, finding.limit) for finding in reversed(checked.findings)}
    close: dict[str, tuple[Finding, float | None]] = {}
    if run.design.branch_count <= TOO_FINE:
        profile = run.profile()
        changed = by_rule(changed_limits(run.design, profile))
        for factor in (1.0 - NEAR, 1.0 + NEAR):
            scaled = {
                rule.id: {
                    name: factor * value
                    for name, value in {**rule.limits, **changed.get(rule.id, {})}.items()
                    if name.endswith(("error", "warning"))
                }
                for rule in RULES.values()
            }
            stricter = check_design(run.design, profile, scaled)
            for finding in stricter.findings:
                if finding.rule not in found and finding.limit is not None:
                    close.setdefault(finding.rule, (finding, finding.limit / factor))
    ranks = list(Severity)
    return tuple(
        (
            one.rule,
            f"{how} ({one.severity}): {one.title if kind is found else RULES[one.rule].title}",
            Number(one.measured, one.unit).text,
            Number(limit, one.unit).text,
            ", ".join(one.branches[:4]),
        )
        for how, kind in (("broken", found), ("close", close))
        for one, limit in sorted(kind.values(), key=lambda pair: ranks.index(pair[0].severity))
    )


def _bound_rows(run: EndedRun) -> Iterator[tuple[str, str, str]]:
    """Yield the variables of the winner that lie at an end of their ranges."""
    space = Space(run.settings.space, run.settings.build)
    point = run.result.finalists[0].x.tolist()
    for variable, share in zip(space.variables, point, strict=True):
        if variable.level > run.design.depth:
            continue
        value, (low, high) = variable.value(share), (variable.bounds.low, variable.bounds.high)
        near = EDGE * (high - low) if not variable.choices else 0.0
        ends = (("least", low), ("most", high))
        for name, end in ends:
            if abs(value - end) <= near:
                of = "" if variable.level == 0 else f", level {variable.level}"
                yield f"{variable.name}{of}", f"{value:g}", f"{name}, {end:g}"


def _found_section(run: EndedRun) -> Section:
    """Return how the winner was found."""
    history = run.result.history
    section = search_section(run.result, ())
    pictures = tuple(replace(picture, file="curve") for picture in section.pictures)
    best, _, _ = curve_of(history)
    last = int(np.argmax(best == best[-1])) + 1 if np.isfinite(best[-1]) else len(history)
    words = [f"The best fitness improved for the last time in generation {last} of {len(history)}."]
    if run.settings.evaluation.fabricable:
        share = 100.0 * float(np.mean([g.fabricable_share for g in history]))
        end = 100.0 * history[-1].fabricable_share
        words.append(
            f"By the quick rules {share:.0f} % of all designs were manufacturable, {end:.0f} % in "
            "the last generation."
        )
    paragraphs = (*section.paragraphs, *words)
    return replace(section, paragraphs=paragraphs, pictures=pictures, folded=True)


def _files_section(run: EndedRun) -> Section:
    """Return what lies beside the page, and where the time went."""
    rows = (
        ("best.toml", "the winner: vinefab grow, score, check, report and fabricate take it"),
        ("run.sqlite", "the record: every generation, maps, settings; vinefab runs reads it"),
        (f"{PICTURES}/", "the pictures of this page"),
    )
    table = Rows(caption="In this folder", headings=("file", "what"), rows=rows)
    return Section(
        title="Files and time",
        paragraphs=(f"The last session: {run.result.times.summary}.",),
        tables=(table,),
        folded=True,
    )
