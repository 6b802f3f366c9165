"""How the pieces of a robot are joined: in which order, and with what at each joint.

Outermost joints first. A strip keeps the two plies of a plug apart while the lap around it is
sealed, and is drawn out through the stub and the open base of the stub's piece: it passes no joint
that is already made. Once all stubs of a piece are taken, its base is its only opening, so each
part of the robot can be tested before it is joined to the next. The piece with the tail comes last.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from vinefab.core.plain_text import counted
from vinefab.model.design import Design
from vinefab.model.laser import LapMethod, LaserProfile
from vinefab.model.pieces import Partition, Sleeve
from vinefab.model.tree import branch_tree
from vinefab.physics.seam import lap_load_n_mm

STRIP_HANDLE_MM = 50.0
"""How far a release strip hangs out of the base of its piece (assumed)."""

TRIM_MM = 2.0
"""Most that is trimmed off a rim whose plies are fused (assumed)."""

MINUTES_PER_JOINT = 8.0
"""Time to lay, seal and inspect one joint (assumed: nobody has timed one)."""

TEST_SHARE = 0.25
"""Pressure of the first test for leaks over the working pressure (assumed)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JoiningStep:
    """One joint, in the order of work."""

    number: int  # from 1
    sleeve: Sleeve
    branch: str  # id of the branch that it lies on
    way_mm: float  # from the stub's rim inside its piece to the piece's base
    strip_leaves: bool  # whether that base is still open
    joined: tuple[str, ...]  # labels of all pieces that hang together after it
    is_last_of_inner: bool  # whether it takes the last stub of its inner piece

    @property
    def strip_mm(self) -> float:
        """Length of the release strip with its pull tape."""
        return self.way_mm + STRIP_HANDLE_MM


def joining_order(design: Design, partition: Partition) -> tuple[JoiningStep, ...]:
    """Return every joint once; a piece is complete before it is joined to its inner one."""
    outer: dict[str, list[Sleeve]] = {piece.label: [] for piece in partition.pieces}
    for sleeve in partition.sleeves:
        outer[sleeve.inner].append(sleeve)
    ways, ids = _ways_mm(design, partition), branch_tree(design).ids
    held = {label: [label] for label in outer}
    steps: list[JoiningStep] = []

    def complete(label: str) -> None:
        for sleeve in outer[label]:
            complete(sleeve.label)
        for sleeve in outer[label]:
            held[label] += held[sleeve.label]
            steps.append(
                JoiningStep(
                    number=len(steps) + 1,
                    sleeve=sleeve,
                    branch=ids[sleeve.branch],
                    way_mm=ways[sleeve.label],
                    strip_leaves=sleeve.inner
                    in open_ends(partition, sleeve, {step.sleeve.label for step in steps}),
                    joined=tuple(held[label]),
                    is_last_of_inner=sleeve is outer[label][-1],
                )
            )

    complete(partition.pieces[0].label)
    return tuple(steps)


def open_ends(partition: Partition, sleeve: Sleeve, made: Collection[str]) -> set[str]:
    """Return by which open ends of its two pieces a joint's strip may leave, once it is sealed.

    An end is named by the joint that is to be made there; the mouth by the first piece, whose base
    it is.

    Parameters
    ----------
    made
        Labels of the joints that are made before.
    """
    own = sleeve.inner, sleeve.label
    stubs = {other.label for other in partition.sleeves if other.inner in own}
    return {sleeve.inner, *stubs} - {sleeve.label, *made}


def _ways_mm(design: Design, partition: Partition) -> dict[str, float]:
    """Return by joint how far its stub's rim is from the base of the stub's piece."""
    tree, build = branch_tree(design), design.build
    roots = {piece.label: piece.root for piece in partition.pieces}
    # What a piece lacks of its first branch; the first piece has the tail besides.
    cut_mm = {sleeve.label: sleeve.outer_from_mm for sleeve in partition.sleeves}
    ways = {}
    for sleeve in partition.sleeves:
        way = sleeve.stub_to_mm - cut_mm.get(sleeve.inner, -build.tail_mm)
        branch = sleeve.branch
        while branch != roots[sleeve.inner]:
            branch = int(tree.parent[branch])
            way += float(tree.length_mm[branch])
        ways[sleeve.label] = way
    return ways


def needs_strips(profile: LaserProfile) -> bool:
    """Whether the plies of a plug must be kept apart; so too where the recipe says nothing."""
    lap = profile.recipe.lap
    return lap is None or lap.method is LapMethod.IMPULSE_SEAL


def order_reasons(profile: LaserProfile) -> str:
    """Return why the outermost joints are made first, in words."""
    strips = (
        " The release strip inside a plug is drawn out through the stub and the open base of the"
        " stub's piece, so it never has to pass a joint that is already made."
    )
    sealer = (
        " Small parts are also easier to lay into an impulse sealer, whose bars must reach across"
        " the lap: fold neighbouring branches out of the way."
    )
    tail = " The piece with the tail comes last: its strips leave through the mouth."
    by_strip = needs_strips(profile)
    return (
        f"Outermost joints first.{strips if by_strip else ''} When all stubs of a piece are taken,"
        " its base is its only opening: test that part for leaks before you go on."
        f"{sealer + tail if by_strip else ' The piece with the tail comes last.'}"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class JoiningWords:
    """What a maker reads about the joints of a robot."""

    needed: tuple[str, ...]  # what it is, what is needed, what is known of the bond
    one_joint: tuple[str, ...]  # what is done at every joint
    steps: tuple[str, ...]  # from the sheets to the robot; every joint once


def joining_words(
    design: Design, partition: Partition, profile: LaserProfile, *, robots: int = 1
) -> JoiningWords:
    """Return how the pieces of a robot are joined, in words.

    Parameters
    ----------
    robots
        Number of robots on the sheets.
    """
    if not partition.sleeves:
        return JoiningWords(needed=(), one_joint=(), steps=())
    return JoiningWords(
        needed=(*_several(robots), *_needed(design, partition, profile)),
        one_joint=tuple(_one_joint(partition.sleeves[0], profile)),
        steps=tuple(_steps(design, partition, profile)),
    )


def pieces_words(partition: Partition) -> str:
    """Return in how many pieces a robot is and what holds them, without a full stop."""
    count = len(partition.sleeves)
    hold = f"{count} sleeve joints hold" if count > 1 else "a sleeve joint holds"
    into = (
        "the base of the outer piece, the plug, goes into the widened stub of the inner one, the"
        " socket"
        if partition.sleeves[0].socket_on_stub
        else "the widened base of the outer piece, the socket, goes over the stub of the inner one,"
        " the plug"
    )
    return f"The robot is in {len(partition.pieces)} flat pieces that {hold} together: {into}"


def _several(robots: int) -> tuple[str, ...]:
    if robots == 1:
        return ()
    note = (
        f"The sheets hold {counted(robots, 'robot')}: the steps are for each of them. Keep copies "
        "apart."
    )
    return (note,)


def widest_socket_mm(partition: Partition) -> float:
    """Return the lay-flat lumen width of the widest socket."""
    return max((one.width_mm + 2.0 * one.rise_mm for one in partition.sleeves), default=0.0)


def _needed(design: Design, partition: Partition, profile: LaserProfile) -> Iterator[str]:
    lap, widest_mm = profile.recipe.lap, max(one.width_mm for one in partition.sleeves)
    yield (
        f"{pieces_words(partition)}. A has the tail. assembly.svg and assembly.pdf show the pieces"
        " apart and put together, one lap, and the order. All lengths are lay-flat, in mm."
    )
    if needs_strips(profile):
        yield (
            "You need: an impulse sealer with bars longer than"
            f" {widest_socket_mm(partition):.1f} mm (the widest socket, computed); release strip"
            " that film does not stick to (PTFE film, baking paper); a thin blunt rod; a felt pen."
        )
    elif lap is not None:
        yield (
            f"You need: adhesive film in bands {lap.band_mm.value:g} mm wide"
            f" ({lap.band_mm.standing}); a felt pen."
        )
    load = lap_load_n_mm(design.build.pressure_kpa, widest_mm)
    bond = f"recipe {profile.recipe.name} has no [lap]: nothing is known of the bond"
    if lap is not None:
        bond = f"recipe {profile.recipe.name}: {lap.words()}"
    yield (
        f"At {design.build.pressure_kpa:g} kPa the widest lap bears {load:.3f} N per mm of rim"
        f" (computed); {bond}. Join and burst lap coupons before you trust a robot to it."
    )
    yield f"{order_reasons(profile)} About {MINUTES_PER_JOINT:g} minutes a joint (assumed)."


def _one_joint(sleeve: Sleeve, profile: LaserProfile) -> Iterator[str]:
    lap, strips = profile.recipe.lap, needs_strips(profile)
    band = "a band" if lap is None else f"a band {lap.band_mm.value:g} mm wide"
    standing = "" if lap is None else f" ({lap.band_mm.standing})"
    yield (
        "Lay both pieces as assembly.svg shows them, both with their letters up, and fold"
        " neighbouring branches out of the way."
    )
    yield (
        "Open plug and socket with a blunt tool: the laser that cuts them may fuse their plies."
        f" Trim a rim that stays shut by {TRIM_MM:g} mm at most, once the plug's line is drawn: so"
        " much of the lap is lost."
    )
    if strips:
        shows = (
            f"it comes out of the socket by {sleeve.lap_mm + TRIM_MM:g} mm, which go into the plug"
            if sleeve.socket_on_stub
            else "it shows at the plug's rim"
        )
        yield (
            "Push a release strip with the rod through the open base of the stub's piece until"
            f" {shows}; where the way is long or bent, first let air carry a thread"
            " through and pull the strip in by it. It must lie flat between the plies, at the lap"
            " nearly as wide as the plug inside; behind the lap it may be narrow, or a thread."
            " Where it cannot be brought, adhesive film bonds the joint without it: try a coupon"
            " first."
        )
    else:
        yield f"Lay {band}{standing} of adhesive film around the plug, in the middle of the lap."
    yield (
        "Push the plug into the socket, without twisting, until the socket's rim lies on the plug's"
        f" line, {sleeve.lap_mm:g} mm deep. The letters on both are the same, and their side seams"
        " lie on each other."
    )
    if strips:
        yield (
            f"Seal {band}{standing} across the lap, in its middle, with the settings that coupons"
            " confirmed: both faces at once, or one after the other if the sealer heats one side."
        )
        yield (
            "Let it cool and draw the strip out. If it sticks, do not pull hard: it was too narrow"
            " or did not reach the rim, and the plug is sealed shut there."
        )
    else:
        yield "Press or heat the lap all around as the adhesive film's data sheet says."
    yield (
        "Look at the two corners, where the side seams of plug and socket lie on each other: it"
        " leaks there first."
    )


def _steps(design: Design, partition: Partition, profile: LaserProfile) -> Iterator[str]:
    first, working_kpa = partition.pieces[0].label, design.build.pressure_kpa
    test = (
        f"inflate slowly, behind a shield, to {TEST_SHARE * working_kpa:g} kPa (a quarter of the"
        " working pressure, assumed) and look for bubbles in soapy water"
    )
    yield (
        "Cut and measure every sheet (sections 1 to 6). Letters and ticks are marked on the film"
        " that is left over: before a piece leaves its place, write on the face that lies up its"
        " letter, the letters of its joints on plugs and socket, and across each plug a line from"
        f" tick to tick, {partition.sleeves[0].lap_mm:g} mm from its rim. assembly.svg shows them"
        " all."
    )
    steps = joining_order(design, partition)
    for step in steps:
        sleeve = step.sleeve
        through = "the mouth" if sleeve.inner == first else f"the base of {sleeve.inner}"
        strip = f" Strip: {step.strip_mm:.0f} mm long, in and out through {through}."
        if not step.strip_leaves:
            strip = " No strip: it could not leave. Bond this joint with adhesive film."
        yield (
            f"Joint {step.number} of {len(steps)}: plug {sleeve.label} into socket {sleeve.label}"
            f" (piece {sleeve.label} {'into' if sleeve.socket_on_stub else 'over'} piece"
            f" {sleeve.inner}, branch {step.branch}, {sleeve.width_mm:.1f} mm wide),"
            f" {sleeve.lap_mm:g} mm deep.{strip if needs_strips(profile) else ''}"
        )
        if step.is_last_of_inner and sleeve.inner != first:
            yield (
                f"Test what hangs together now ({', '.join(step.joined)}): close the base of"
                f" {sleeve.inner} around an air tube, {test}, at the new laps first."
            )
    yield (
        f"Test the whole robot: clamp the mouth around an air tube, {test}; then go up to"
        f" {working_kpa:g} kPa (working pressure of the design). The robot need not lie flat:"
        " branches may cross."
    )
    if needs_strips(profile):
        strips = sum(step.strip_leaves for step in steps)
        yield f"Count the strips: {strips} went in, {strips} must have come out."
