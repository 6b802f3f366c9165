"""Figure 4: one branched deployment against many of a plain vine."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from scipy.sparse.csgraph import connected_components

from vinefab.core.hashing import fingerprint
from vinefab.core.validation import Floats
from vinefab.core.version import __version__
from vinefab.growth.options import GrowthOptions
from vinefab.growth.simulator import grow
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.map import Pose
from vinefab.pages.figure import svg_bytes
from vinefab.pages.html import Picture
from vinefab.search.settings import MapSettings, PartSettings, RunSettings, plain_settings
from vinefab.studies.claims import (
    Claim,
    ConfidenceInterval,
    PaperNumber,
    StudyResult,
    difference,
    interval,
    interval_text,
    percent_text,
)
from vinefab.studies.paper_charts import Panel, reach_plan
from vinefab.studies.study_jobs import (
    DEFAULT_GROWTH,
    FIRST_UNSEEN,
    JobStore,
    StudySize,
    Testing,
    design_from,
    design_words,
    plain_design,
    plain_vine,
    site,
)
from vinefab.studies.study_runs import (
    ENVIRONMENTS,
    NAMES,
    coverage_run,
    kept,
    maps_of,
    study_scores,
    trained,
    unseen_test,
)
from vinefab.tasks.evaluate import PreparedMap, poses_on
from vinefab.tasks.reach import near_chains

FAN_DEG = 120.0
"""Headings are spread evenly over so much, around the start's own."""

SAME_MM = 10.0
"""Final shapes whose tips are nearer than this, directly or through others, count as one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RedeploymentJob:
    """An unbranched robot on one map, from one place, with many headings."""

    design: Mapping[str, Any]  # as plain values
    worlds: MapSettings  # the map: the first of these
    headings: int  # how many
    buffer_mm: float  # distance from the body that counts as reached
    growth: GrowthOptions = DEFAULT_GROWTH  # how robots grow

    @property
    def key(self) -> str:
        """Fingerprint of everything that it depends on."""
        return f"redeploy_{fingerprint(plain_settings(self), __version__)}"

    def run(self) -> dict[str, Any]:
        """Return the share of free space reached by all together, and the final shapes.

        ``shapes``; ``stops``, how often each reason stopped a growth; ``each``, the mean share
        that one deployment reaches.
        """
        place = site(self.worlds, 0)
        grown = self.deployments(place)
        tips_mm = np.array([deployment.tips_mm[0] for deployment in grown])
        each = [self.reached(place, [deployment]) for deployment in grown]
        stops = [Stop(int(deployment.stop[0])).label for deployment in grown]
        return {
            "share": self.reached(place, grown),
            "each": float(np.mean(each)),
            "shapes": _groups(tips_mm),
            "stops": {stop.label: stops.count(stop.label) for stop in Stop},
        }

    def deployments(self, place: PreparedMap) -> list[Deployment]:
        """Return one growth for each heading."""
        ((start,),) = poses_on([place], 1, [self.worlds.seed])
        middle_rad = place.world.starts[0].pose.heading_rad
        half_rad = math.radians(FAN_DEG / 2.0)
        design = design_from(self.design)
        poses = [
            Pose(x_mm=start.x_mm, y_mm=start.y_mm, heading_rad=middle_rad + offset)
            for offset in np.linspace(-half_rad, half_rad, self.headings).tolist()
        ]
        return [grow(design, place.terrain, pose, self.growth) for pose in poses]

    def reached(self, place: PreparedMap, grown: list[Deployment]) -> float:
        """Return the share of free space within the buffer of all bodies together."""
        near = near_chains([d.chain_mm(0).tolist() for d in grown], self.buffer_mm)
        return float(shapely.intersection(near, place.context.free).area / place.context.area_mm2)


def _groups(tips_mm: Floats) -> int:
    """Return how many groups of tips there are."""
    apart_mm = np.hypot(*(tips_mm[:, None] - tips_mm[None]).transpose(2, 0, 1))
    return int(connected_components(apart_mm < SAME_MM)[0])


BUFFER_MM = 40.0
"""Twelve to a 500 mm map. The paper does not publish its buffer; this one is assumed."""

MOST = 0.9
"""What one branched deployment should reach; the paper's reached 93 and 94 %."""

LONG_MM = 1500.0
"""A plain vine so long that walls stop it, not its length."""

PAPER_REACH = {
    "grid": {"one": "93.0 %", "many": "68.3 %", "shapes": "6", "more": "24.7"},
    "cave": {"one": "94.3 %", "many": "61.6 %", "shapes": "5", "more": "32.7"},
}
REACH = PartSettings(name="reach", parameters={"buffer_mm": BUFFER_MM})


def reach_run(size: StudySize, environment: str, number: int) -> RunSettings:
    """Return a run that is paid for what it reaches and for nothing else, as in the paper."""
    run = coverage_run(size, environment, number)
    return replace(
        run,
        name=f"reach_{environment}",
        task=REACH,
        search=replace(
            run.search, population=size.wide_population, generations=size.wide_generations
        ),
    )


def redeployments(size: StudySize, environment: str) -> list[RedeploymentJob]:
    """Return the plain vine's redeployments on every unseen map."""
    return [
        RedeploymentJob(
            design=plain_design(plain_vine(LONG_MM)),
            worlds=maps_of(environment, FIRST_UNSEEN + index, 1),
            headings=size.headings,
            buffer_mm=BUFFER_MM,
        )
        for index in range(size.reach_maps)
    ]


def reach_test(size: StudySize, design: dict[str, Any], environment: str) -> Testing:
    """Return the test of one deployment on the same maps, from the same places."""
    worlds = maps_of(environment, FIRST_UNSEEN, size.reach_maps)
    return replace(unseen_test(size, design, environment, REACH), worlds=worlds, poses=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Redeployments:
    """What was found in one environment."""

    design: dict[str, Any]  # the kept design
    one: Floats  # share reached by one deployment of it, shape (1, maps, 1)
    all_seeds: Floats  # the same for all trained designs, shape (runs, maps, 1)
    # many, each, shapes: share reached by all redeployments of the plain vine together, by one of
    # them on average, and the number of final shapes, each of shape (1, maps, 1)
    many: Floats
    each: Floats
    shapes: Floats
    stops: dict[str, int]  # how often each reason stopped a plain vine


def redeployment_study(store: JobStore) -> StudyResult:
    """Compare branching and redeploying in both environments."""
    size = store.size
    found = {environment: _measured(store, environment) for environment in ENVIRONMENTS}
    return StudyResult(
        name="reach",
        title="Reachability (Fig. 4)",
        protocol=(
            f"A plain vine of {LONG_MM:g} mm was deployed {size.headings} times from one place "
            f"with headings spread over {FAN_DEG:g} degrees; what lies within {BUFFER_MM:g} mm of "
            "any of its bodies counts as reached. The branching design was trained on the same "
            f"measure ({size.training_maps} maps, {size.seeds} seeds, no cost for film or "
            f"branches) and deployed once from that place. {size.reach_maps} unseen maps of 500 mm "
            "in each environment, areas exact.",
            f"Buffer, lengths and map size are assumed: the paper publishes none of them. Two "
            f"final shapes count as one when their tips lie within {SAME_MM:g} mm. The paper shows "
            "one example of each environment and does not say whether its design had met that map "
            "in training; here no map was met.",
        ),
        rows=tuple(row for environment in ENVIRONMENTS for row in _rows(environment, found, size)),
        claims=tuple(
            claim for environment in ENVIRONMENTS for claim in _claims(environment, found, size)
        ),
        remarks=(
            "The branching designs are as large as Table 1 allows, because nothing is charged for "
            "film here: no such robot can be cut ('price' says what those that can be made reach). "
            "The buffer reaches through thin walls in this measure, for both kinds of robot alike.",
            "How far a tree gets in a Cave is decided by how interconnected its passages are: with "
            "every short cut open, as here, most places can be reached in a few bends; with 0.4 of "
            "them open ('ablation'), long tours remain that five levels cannot follow. The share "
            "was chosen on training maps by what the plain vines reach there, not the trees.",
        ),
        pictures=(_picture(store.size, found),),
        data={
            environment: {
                "one": part.all_seeds.tolist(),
                "many": part.many.ravel().tolist(),
                "shapes": part.shapes.ravel().tolist(),
                "stops": part.stops,
                "design": part.design,
            }
            for environment, part in found.items()
        },
    )


def _measured(store: JobStore, environment: str) -> Redeployments:
    size = store.size
    runs = trained(store, [reach_run(size, environment, number) for number in range(size.seeds)])
    again = store.do(redeployments(size, environment), "redeploying")
    all_seeds = study_scores(store, [reach_test(size, run["design"], environment) for run in runs])

    def column(name: str) -> Floats:
        return np.array([part[name] for part in again], dtype=float).reshape(1, -1, 1)

    return Redeployments(
        design=runs[kept(runs)]["design"],
        one=all_seeds[kept(runs)][None],
        all_seeds=all_seeds,
        many=column("share"),
        each=column("each"),
        shapes=column("shapes"),
        stops={name: sum(part["stops"][name] for part in again) for name in again[0]["stops"]},
    )


def _rows(environment: str, found: dict[str, Redeployments], size: StudySize) -> list[PaperNumber]:
    part, paper, name = found[environment], PAPER_REACH[environment], NAMES[environment]
    more = difference(part.one, part.many)
    points = ", ".join(f"{100 * value:.1f}" for value in (more.low, more.high))
    return [
        PaperNumber(what=f"{name}: branching design", ours=design_words(design_from(part.design))),
        PaperNumber(
            what=f"{name}: reached by one branched deployment",
            ours=percent_text(interval(part.one)),
            paper=paper["one"],
        ),
        PaperNumber(
            what=f"{name}: maps of which it reaches more than {100 * MOST:.0f} %",
            ours=percent_text(interval((part.one > MOST).astype(float))),
        ),
        PaperNumber(
            what=f"{name}: reached by {size.headings} of a plain vine",
            ours=percent_text(interval(part.many)),
            paper=paper["many"],
        ),
        PaperNumber(
            what=f"{name}: branching above plain, points",
            ours=f"{100 * more.value:.1f} [{points}]",
            paper=paper["more"],
        ),
        PaperNumber(
            what=f"{name}: reached by one of a plain vine",
            ours=percent_text(interval(part.each)),
        ),
        PaperNumber(
            what=f"{name}: final shapes of {size.headings} headings",
            ours=interval_text(interval(part.shapes), 1),
            paper=paper["shapes"],
        ),
        PaperNumber(
            what=f"{name}: what stopped the plain vines",
            ours=", ".join(f"{stop} {n}" for stop, n in part.stops.items() if n),
        ),
    ]


def _claims(environment: str, found: dict[str, Redeployments], size: StudySize) -> list[Claim]:
    part, name = found[environment], NAMES[environment]
    few = 0.2 * size.headings
    return [
        Claim(
            text=f"{name}: one branched deployment reaches more than {size.headings} plain ones",
            tested=difference(part.all_seeds, part.many),
            kept=difference(part.one, part.many),
        ),
        Claim(
            text=f"{name}: it reaches more than {100 * MOST:.0f} % (share above that)",
            tested=_above(part.all_seeds, MOST),
            kept=_above(part.one, MOST),
        ),
        Claim(
            text=f"{name}: {size.headings} plain deployments reach less than 70 % (share below)",
            tested=_above(-part.many, -0.7),
        ),
        Claim(
            text=f"{name}: {size.headings} headings condense to fewer than {few:g} shapes",
            tested=_above(-part.shapes, -few),
            digits=1,
        ),
    ]


def _above(values: Floats, limit: float) -> ConfidenceInterval:
    return interval(values - limit)


def _picture(size: StudySize, found: dict[str, Redeployments]) -> Picture:
    panels = []
    for environment in ENVIRONMENTS:
        job = redeployments(size, environment)[0]
        place = site(job.worlds, 0)
        ((pose,),) = poses_on([place], 1, [job.worlds.seed])
        one = grow(design_from(found[environment].design), place.terrain, pose, DEFAULT_GROWTH)
        shares = [found[environment].one[0, 0, 0], found[environment].many[0, 0, 0]]
        titles = ("one branched deployment", f"{size.headings} of a plain vine")
        for title, share, grown in zip(
            titles, shares, ([one], job.deployments(place)), strict=True
        ):
            panels.append(
                Panel(
                    title=f"{NAMES[environment]}: {title}, {100 * share:.0f} %",
                    world=place.world,
                    deployments=tuple(grown),
                    buffer_mm=BUFFER_MM,
                )
            )
    return Picture(
        image=svg_bytes(reach_plan(panels)),
        caption="What lies within the buffer of the body, on the first unseen map of each "
        "environment (simulated). Left: the kept branching design, once. Right: all redeployments "
        "of a plain vine together.",
        wide=True,
    )
