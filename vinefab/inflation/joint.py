"""One joint under pressure: deployed angles, places, loads of crotches; in a plane or free.

The joint is cut from the pattern with a stub of trunk and of each child, so long that more makes no
difference. All lengths are in widths of the trunk.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy  # its parts load at their first use

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, Ints
from vinefab.inflation.membrane import Bools, Equilibrium, Membrane, at_rest
from vinefab.inflation.mesh import (
    LEAST_ANGLE_DEG,
    Sheet,
    SheetMesh,
    StraightSide,
    followed,
    sheet_of,
    tube_stretch,
    turned_deg,
)
from vinefab.model.outline import Contour, Part
from vinefab.outline.ends import round_tip
from vinefab.outline.joint import (
    Core,
    LocalFrame,
    Pen,
    Point,
    Strip,
    inner_bend,
    outer_bends,
    placed,
    polar,
    solve_gap,
)

ACROSS = 8
"""Triangles across a tube."""

TRUNK_STUB, CHILD_STUB = 1.5, 2.5
"""Length of the straight stubs, in their own widths."""

_DRAWN_MM = 100.0  # width of the trunk where the outline, which knows millimetres, is drawn
_FAR_MM = 1e6
_NEAR_TIP, _NEAR_JOINT = 0.75, 0.75  # lengths of a stub, in its widths, that its axis leaves out
_TURN_RAD = 1e-3  # by which sensitivities are differences
_FARTHEST = 10.0  # widths of the trunk within which neighbours part; 15 take 40 s
_GRID = 24.0  # points across the trunk where balls are tried


@dataclass(frozen=True, slots=True, kw_only=True)
class JointShape:
    """A joint of a flat pattern.

    Parameters
    ----------
    angles_deg
        Flat angle from the trunk's heading to each child's, counter-clockwise positive, rising.
    widths
        Width of each child, over the trunk's.
    fillets
        Fillet radius in each gap, over the trunk's width: from the trunk's right side to the first
        child, between children, from the last child to the trunk's left side.
    hoop_strain
        p W / (pi E t) of the trunk.
    is_bend
        Whether its only child is the trunk itself behind a preformed bend: an elbow.
    """

    angles_deg: tuple[float, ...]
    widths: tuple[float, ...]
    fillets: tuple[float, ...]
    hoop_strain: float = 0.01
    is_bend: bool = False

    def __post_init__(self) -> None:
        count = len(self.angles_deg)
        if not 1 <= count <= 100:
            raise BadInputError("angles_deg", self.angles_deg, "1 to 100 children")
        for name, values, wanted in (
            ("widths", self.widths, count),
            ("fillets", self.fillets, count + 1),
        ):
            if len(values) != wanted:
                raise BadInputError(name, values, f"{wanted} numbers")
        if any(two <= one for one, two in pairwise((-180.0, *self.angles_deg, 180.0))):
            raise BadInputError("angles_deg", self.angles_deg, "rising angles within 180 degrees")
        if not all(0.0 < width <= 1.5 for width in self.widths):
            raise BadInputError("widths", self.widths, "numbers above 0, at most 1.5")
        if not all(0.0 <= fillet <= 10.0 for fillet in self.fillets):
            raise BadInputError("fillets", self.fillets, "numbers of 0 to 10")
        if not 0.0 < self.hoop_strain <= 1.0:
            raise BadInputError("hoop_strain", self.hoop_strain, "a number above 0, at most 1")

    @classmethod
    def fan(
        cls,
        children: int,
        fan_deg: float,
        *,
        width: float,
        fillet: float,
        hoop_strain: float = 0.01,
    ) -> "JointShape":
        """Return a joint with an even fan, as designs have: equal children, equal fillets."""
        turns = np.linspace(-fan_deg / 2.0, fan_deg / 2.0, children) if children > 1 else [0.0]
        return cls(
            angles_deg=tuple(float(turn) for turn in turns),
            widths=(width,) * children,
            fillets=(fillet,) * (children + 1),
            hoop_strain=hoop_strain,
        )

    def with_angles(self, angles_deg: tuple[float, ...]) -> "JointShape":
        """Return the joint with other flat angles."""
        return replace(self, angles_deg=angles_deg)

    @property
    def mirrored(self) -> "JointShape":
        """The joint seen from below."""
        return replace(
            self,
            angles_deg=tuple(0.0 - angle for angle in reversed(self.angles_deg)),
            widths=tuple(reversed(self.widths)),
            fillets=tuple(reversed(self.fillets)),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class JointOutline:
    """The outline of a joint with its stubs, in widths of the trunk.

    The joint, where the axes meet, is the origin, and the trunk's heading is +x.
    """

    contour: Contour  # closed; the segment of `Part.MOUTH` is the cut through the trunk
    straights: tuple[StraightSide, ...]  # the trunk's stub, then the children's


def joint_outline(
    joint: JointShape, *, trunk_stub: float = TRUNK_STUB, child_stub: float = CHILD_STUB
) -> JointOutline:
    """Return the outline of a joint with stubs of so many of their own widths.

    Raises
    ------
    BadInputError
        If two neighbours part too far from the joint.
    """
    half = _DRAWN_MM / 2.0
    parent = Strip(angle_rad=-math.pi, half_mm=half, length_mm=_FAR_MM, owner=0)
    around = [
        parent,
        *(
            Strip(
                angle_rad=math.radians(angle), half_mm=half * width, length_mm=_FAR_MM, owner=child
            )
            for child, (angle, width) in enumerate(
                zip(joint.angles_deg, joint.widths, strict=True), start=1
            )
        ),
        replace(parent, angle_rad=math.pi),
    ]
    core = Core(radius_mm=half * max(1.0, *joint.widths))
    gaps = []
    for (one, two), fillet in zip(pairwise(around), joint.fillets, strict=True):
        is_inside = joint.is_bend and two.angle_rad - one.angle_rad < math.pi
        gaps.append((inner_bend if is_inside else solve_gap)(one, two, core, fillet * _DRAWN_MM))
    if joint.is_bend:
        inner_mm = min(joint.fillets) * _DRAWN_MM
        gaps = outer_bends(gaps, inner_mm + _DRAWN_MM)
    begins = [
        max(right.second_used_mm, left.first_used_mm) / _DRAWN_MM for right, left in pairwise(gaps)
    ]
    if max(begins) > _FARTHEST:
        far = f"which part {max(begins):.0f} widths of the trunk from the joint"
        allowed = f"a smaller fillet or wider angles: at most {_FARTHEST:g} are simulated"
        key, values = ("fillets", joint.fillets) if max(joint.fillets) > 1.0 else (
            "angles_deg", joint.angles_deg
        )  # fmt: skip
        given = ", ".join(f"{value:.3g}" for value in values)
        raise BadInputError(key, f"{given}, {far}", allowed)
    trunk_used = max(gaps[0].first_used_mm, gaps[-1].second_used_mm) / _DRAWN_MM + 0.15
    mouth = -(trunk_used + trunk_stub) * _DRAWN_MM
    origin, names = LocalFrame((0.0, 0.0), 0.0), [str(number) for number in range(len(around) - 1)]
    pen = Pen((mouth, -half))
    for child, (gap, (begin, width, angle)) in enumerate(
        zip(
            gaps,
            [*zip(begins, joint.widths, joint.angles_deg, strict=True), (0, 0, 0)],
            strict=True,
        )
    ):
        pen.go_to(placed(gap.run.start_mm, origin), Part.SIDE, names[child])
        pen.pieces(gap.run, origin, names)
        if child == len(begins):
            break
        heading = math.radians(angle)
        end = LocalFrame(polar((begin + child_stub * width) * _DRAWN_MM, heading), heading)
        tip = round_tip(half * width)
        pen.go_to(placed(tip.run.start_mm, end), Part.SIDE, names[child + 1])
        pen.pieces(tip.run, end, [names[child + 1]])
    pen.go_to((mouth, half), Part.SIDE, names[0])
    drawn = pen.contour()
    contour = Contour(
        points_mm=drawn.points_mm / _DRAWN_MM,
        bulges=np.append(drawn.bulges, 0.0),
        parts=(*drawn.parts, Part.MOUTH),
        branches=(*drawn.branches, names[0]),
        closed=True,
    )
    center: Point = (0.0, 0.0)
    trunk = StraightSide(
        origin=center,
        heading_rad=0.0,
        begin=mouth / _DRAWN_MM,
        end=-trunk_used,
        half_begin=0.5,
        half_end=0.5,
    )
    children = (
        StraightSide(
            origin=center,
            heading_rad=math.radians(angle),
            begin=begin,
            end=begin + child_stub * width,
            half_begin=width / 2.0,
            half_end=width / 2.0,
        )
        for begin, width, angle in zip(begins, joint.widths, joint.angles_deg, strict=True)
    )
    return JointOutline(contour=contour, straights=(trunk, *children))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InflatedJoint:
    """A joint under pressure (simulated). Lengths are in widths of the trunk.

    The deployed joint is the point of the trunk's deployed axis where the flat joint would lie if
    the trunk's tube ran on. A point of a child's axis that was at a distance s from the flat joint
    lies at the distance a s - pull_back along the child's deployed heading from the deployed
    joint, with the stretch a of its straight tube, and side_offset to the left of it.
    """

    joint: JointShape
    angles_deg: Floats  # deployed angle of each child to the trunk's axis, shape (n,)
    pull_backs: Floats  # shape (n,)
    side_offsets: Floats  # shape (n,)
    sheet: Sheet
    equilibrium: Equilibrium

    @property
    def gap_loads(self) -> Floats:
        """Largest weld load in each gap over that of the trunk's seam, shape (n + 1,).

        The first and the last lie between the trunk's side and a child.
        """
        mesh = self.sheet.mesh
        load = self.sheet.seam_loads(self.equilibrium)
        trunk, *children = mesh.sides
        straight = [side[len(side) // 4 : 3 * len(side) // 4 + 1] for side in trunk]
        usual = float(np.nanmean(load[np.concatenate(straight)]))
        # Walking around, a gap lies between the last straight side and the next.
        starts = [trunk[0][-1], *(side[1][0] for side in children)]
        ends = [*(side[0][0] for side in children), trunk[1][-1]]
        worst = []
        for start, end in zip(starts, ends, strict=True):
            count = int(end - start) % len(mesh.seam) + 1
            worst.append(np.nanmax(load[(start + np.arange(count)) % len(mesh.seam)]) / usual)
        return np.array(worst)

    @property
    def crotch_load(self) -> float:
        """The largest of `gap_loads` between two children; of a single child the largest of all."""
        loads = self.gap_loads
        return float((loads[1:-1] if len(loads) > 2 else loads).max())

    @property
    def passages(self) -> Floats:
        """Largest ball from the trunk into each child, over the child's tube, at most 1."""
        mesh, positions = self.sheet.mesh, self.equilibrium.positions
        seam = positions[mesh.seam, :2]
        (x0, y0), (x1, y1) = seam.min(axis=0), seam.max(axis=0)
        step = 1.0 / _GRID
        x, y = np.arange(x0, x1 + step, step), np.arange(y0, y1 + step, step)
        grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
        # The film as a cloud of points, finer than the grid.
        corners = positions[mesh.triangles]
        shares = [(a, b, 4 - a - b) for a in range(5) for b in range(5 - a)]
        cloud = np.concatenate([np.tensordot(np.array(s) / 4.0, corners, (0, 1)) for s in shares])
        within = _covered(corners[:, :, :2], (x, y))
        level = np.column_stack([grid[within], np.zeros(np.count_nonzero(within))])
        room = np.zeros(grid.shape[:2])
        room[within] = scipy.spatial.cKDTree(cloud, balanced_tree=False).query(level)[0]

        def at(sides: tuple[Ints, Ints]) -> tuple[int, int]:
            right, left = sides
            middle = (positions[right, :2] + positions[left, :2])[len(right) // 2] / 2.0
            return round((middle[0] - x0) / step), round((middle[1] - y0) / step)

        trunk, *children = [at(sides) for sides in mesh.sides]
        passages = []
        for child in children:
            own = float(
                room[max(child[0] - 2, 0) : child[0] + 3, max(child[1] - 2, 0) : child[1] + 3].max()
            )
            low, high = 0.0, own
            for _ in range(12):
                tried = (low + high) / 2.0
                label, _ = scipy.ndimage.label(room >= tried)
                near = label[child[0] - 2 : child[0] + 3, child[1] - 2 : child[1] + 3]
                home = label[trunk[0] - 2 : trunk[0] + 3, trunk[1] - 2 : trunk[1] + 3]
                joined = np.intersect1d(near[near > 0], home[home > 0])
                low, high = (tried, high) if len(joined) else (low, tried)
            passages.append(min(1.0, high / own))
        return np.array(passages)

    def sensitivity(self) -> Floats:
        """Return d deployed / d flat: row i, column j for child i by the flat angle of child j.

        From the factorized Hessian at the equilibrium: the flat triangles follow the outline of a
        slightly turned child, and the equilibrium follows to first order.
        """
        joint, sheet = self.joint, self.sheet

        def outline(angles_deg: tuple[float, ...]) -> JointOutline:
            return _outline_like(self, joint.with_angles(angles_deg))

        here, columns = outline(joint.angles_deg), []
        for child_number in range(len(joint.angles_deg)):
            turns, measured = [], []
            for way in (1.0, -1.0):
                angles = list(joint.angles_deg)
                angles[child_number] += way * math.degrees(_TURN_RAD)
                try:
                    there = outline(tuple(angles))
                    followed_mesh = followed(
                        sheet.mesh, here.contour, there.contour, there.straights
                    )
                except BadInputError:  # an arc begins or ends right here: the other way tells
                    continue
                turned = Membrane(
                    followed_mesh.points,
                    sheet.mesh.triangles,
                    sheet.membrane.free,
                    hoop_strain=joint.hoop_strain,
                )
                positions = self.equilibrium.positions.copy()
                pull = turned.gradient(positions)
                positions[turned.free] -= self.equilibrium.stiffness.solve(pull)
                turns.append(way * math.degrees(_TURN_RAD))
                measured.append(_measured(sheet.mesh, positions, joint.hoop_strain)[0])
            if not turns:
                allowed = "angles at which the outline changes smoothly"
                raise BadInputError("angles_deg", joint.angles_deg, allowed)
            if len(turns) < 2:
                turns.append(0.0)
                measured.append(self.angles_deg)
            columns.append((measured[0] - measured[1]) / (turns[0] - turns[1]))
        return np.column_stack(columns)


def inflated_joint(
    joint: JointShape,
    *,
    across: int = ACROSS,
    trunk_stub: float = TRUNK_STUB,
    child_stub: float = CHILD_STUB,
) -> InflatedJoint:
    """Return a joint under pressure.

    Parameters
    ----------
    across
        Triangles across a tube, even.
    trunk_stub, child_stub
        Length of the straight stubs, in their own widths.

    Raises
    ------
    BadInputError
        If the outline cannot be filled with triangles, as where children overlap on the sheet.
    NotConvergedError
        If no equilibrium is found.
    """
    outline = joint_outline(joint, trunk_stub=trunk_stub, child_stub=child_stub)
    widths = {"0": 1.0} | {str(k): width for k, width in enumerate(joint.widths, start=1)}
    sheet = sheet_of(
        outline.contour,
        outline.straights,
        widths,
        across=across,
        hoop_strain=joint.hoop_strain,
    )
    return _inflated(joint, sheet, sheet.inflated())


def turned_joint(found: InflatedJoint, angles_deg: tuple[float, ...]) -> InflatedJoint:
    """Return a joint under pressure whose children are turned a little on the sheet.

    The triangles follow the outline, so that results change smoothly with the angles.

    Raises
    ------
    BadInputError
        If the outline changes too much to be followed.
    NotConvergedError
        If no equilibrium is found.
    """
    joint, sheet = found.joint.with_angles(angles_deg), found.sheet
    here, there = _outline_like(found, found.joint), _outline_like(found, joint)
    mesh = followed(sheet.mesh, here.contour, there.contour, there.straights)
    if mesh.least_angle_deg < LEAST_ANGLE_DEG or not mesh.is_unfolded:
        raise BadInputError("angles_deg", angles_deg, "angles near the last ones")
    membrane = Membrane(
        mesh.points, mesh.triangles, sheet.membrane.free, hoop_strain=joint.hoop_strain
    )
    turned = Sheet(mesh=mesh, membrane=membrane, is_seam=sheet.is_seam)
    start = found.equilibrium.positions.copy()
    start[:, :2] += mesh.points - sheet.mesh.points
    return _inflated(joint, turned, turned.inflated(start=start))


def _outline_like(found: InflatedJoint, joint: JointShape) -> JointOutline:
    """Return the outline of a joint with stubs as long as another one's."""
    trunk, child = found.sheet.mesh.straights[:2]
    return joint_outline(
        joint,
        trunk_stub=trunk.end - trunk.begin,
        child_stub=(child.end - child.begin) / joint.widths[0],
    )


def _inflated(joint: JointShape, sheet: Sheet, found: Equilibrium) -> InflatedJoint:
    angles, backs, offsets = _measured(sheet.mesh, found.positions, joint.hoop_strain)
    return InflatedJoint(
        joint=joint,
        angles_deg=angles,
        pull_backs=backs,
        side_offsets=offsets,
        sheet=sheet,
        equilibrium=found,
    )


# --- Measures -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """The deployed axis of a straight stretch."""

    heading: Floats  # unit vector, shape (2,), or (3,) in space
    center: Floats  # a point of it, of the same shape
    along: float  # place along the flat axis of that point


def axis_of(
    straight: StraightSide, sides: tuple[Floats, Floats], leave: tuple[float, float]
) -> Axis:
    """Return the straight line through the middles between the deployed sides of a stretch.

    Parameters
    ----------
    sides
        Deployed points of its right and left side, from its beginning on, shape (k, 2) each, or
        (k, 3) in space.
    leave
        Lengths at its beginning and its end that do not count, as far as three points are left.
    """
    middle = (sides[0] + sides[1]) / 2.0
    place = np.linspace(straight.begin, straight.end, len(middle))
    # Ends that count in part let no result jump where one more point fits in.
    step = place[1] - place[0]
    ramp = np.minimum(place - straight.begin - leave[0], straight.end - leave[1] - place)
    weight = np.clip(ramp / step + 0.5, 0.0, 1.0)
    if np.count_nonzero(weight) < 3:
        weight = np.zeros(len(place))
        weight[max(0, len(place) // 2 - 1) : len(place) // 2 + 2] = 1.0
    total = weight.sum()
    center, along = weight @ middle / total, float(weight @ place / total)
    away = place - along
    heading = (weight * away) @ (middle - center)
    return Axis(heading=heading / np.linalg.norm(heading), center=center, along=along)


def stub_axes(mesh: SheetMesh, positions: Floats) -> list[Axis]:
    """Return the deployed axes of the trunk's stub and the children's, from corners in 2 or 3 d."""
    axes: list[Axis] = []
    for straight, (right, left) in zip(mesh.straights, mesh.sides, strict=True):
        width = 2.0 * straight.half_end
        # The trunk's stub begins at the mouth, which is not an end.
        leave = (_NEAR_JOINT * width, _NEAR_TIP * width) if axes else (0.0, _NEAR_JOINT * width)
        axes.append(axis_of(straight, (positions[right], positions[left]), leave))
    return axes


def _measured(
    mesh: SheetMesh, positions: Floats, hoop_strain: float
) -> tuple[Floats, Floats, Floats]:
    """Return deployed angles, pull-backs and side offsets of the children."""
    axes = stub_axes(mesh, positions[:, :2])
    trunk = axes[0]
    along = [tube_stretch(hoop_strain * 2.0 * tube.half_end)[1] for tube in mesh.straights]
    deployed_joint = trunk.center - along[0] * trunk.along * trunk.heading
    angles, backs, offsets = [], [], []
    for axis, stretch in zip(axes[1:], along[1:], strict=True):
        angles.append(turned_deg(trunk.heading, axis.heading))
        away = axis.center - deployed_joint
        backs.append(stretch * axis.along - float(away @ axis.heading))
        offsets.append(float(axis.heading[0] * away[1] - axis.heading[1] * away[0]))
    return np.array(angles), np.array(backs), np.array(offsets)


def _covered(triangles: Floats, axes: tuple[Floats, Floats]) -> Bools:
    """Return whether points of a grid lie under triangles, shape (m, 3, 2)."""
    x, y = axes
    covered = np.zeros((len(x), len(y)), dtype=np.bool_)
    (left, low), (right, high) = triangles.min(axis=1).T, triangles.max(axis=1).T
    first = np.searchsorted(x, left), np.searchsorted(y, low)
    count = (
        np.searchsorted(x, right, "right") - first[0],
        np.searchsorted(y, high, "right") - first[1],
    )
    corners = triangles.transpose(1, 2, 0)
    # The points in the box of each triangle, those at one place of all boxes at a time.
    for step in np.ndindex(int(count[0].max()), int(count[1].max())):
        some = np.flatnonzero((count[0] > step[0]) & (count[1] > step[1]))
        i, j = first[0][some] + step[0], first[1][some] + step[1]
        signs = [
            (b[0] - a[0]) * (y[j] - a[1]) - (b[1] - a[1]) * (x[i] - a[0])
            for a, b in ((corners[k][:, some], corners[(k + 1) % 3][:, some]) for k in range(3))
        ]
        on = (np.min(signs, axis=0) >= 0.0) | (np.max(signs, axis=0) <= 0.0)
        covered[i[on], j[on]] = True
    return covered


# --- Free in space --------------------------------------------------------------------------------

_FREE_TRUNK_STUB = 2.5
"""Length of the trunk's stub, in its width: more than in the plane, as the trunk leans too."""

_SEED = 0.02
"""Height in widths, over length squared, by which the start is bent out of the plane."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeJoint:
    """A joint under pressure that may bow (simulated), in widths of its trunk."""

    planar: InflatedJoint  # the same joint with its seam held in the plane
    angles_deg: Floats  # deployed angle of each child to the trunk, seen from above, shape (n,)
    bow_deg: Floats  # by which each child leans out of the plane of trunk and seam, shape (n,)
    energy: float  # of both sheets, over p W^3
    positions: Floats  # corners of both sheets in space: `planar`'s, then the lower ones
    triangles: Ints  # of both sheets, counter-clockwise as seen from outside

    @property
    def gain(self) -> float:
        """By how much less the energy is than in the plane, over p W^3."""
        return 2.0 * self.planar.equilibrium.energy - self.energy


def free_joint(joint: JointShape, *, across: int = ACROSS) -> FreeJoint:
    """Return a joint under pressure, free to bow out of its plane; for studies.

    Everything that is cut, and every table, takes the seam to stay in its plane, as it does between
    a floor and a lid. Free in space, joints of stiff film bow out of it: the sheets have more film
    than the bent seam needs, and a child that leans takes up some of it. The energy that this frees
    is that of lifting a branch.

    Parameters
    ----------
    across
        Triangles across a tube, even.

    Raises
    ------
    BadInputError
        If the outline cannot be filled with triangles.
    NotConvergedError
        If no equilibrium is found.

    Examples
    --------
    >>> tube = JointShape(angles_deg=(0.0,), widths=(1.0,), fillets=(0.1, 0.1))
    >>> bool(free_joint(tube, across=4).bow_deg[0] < 1.0)
    True
    """
    planar = inflated_joint(
        joint, across=across, trunk_stub=_FREE_TRUNK_STUB, child_stub=CHILD_STUB
    )
    membrane, start = both_sheets(planar.sheet, planar.equilibrium)
    found = at_rest(membrane, start)
    trunk, *children = stub_axes(planar.sheet.mesh, found.positions)
    forward, side = trunk.heading, np.array([0.0, 1.0, 0.0])
    up = np.cross(forward, side)
    side = np.cross(up, forward)
    headings = np.array([child.heading for child in children])
    along, across_, above = (headings @ axis for axis in (forward, side, up))
    return FreeJoint(
        planar=planar,
        angles_deg=np.degrees(np.arctan2(across_, along)),
        bow_deg=np.abs(np.degrees(np.arcsin(np.clip(above, -1.0, 1.0)))),
        energy=found.energy,
        positions=found.positions,
        triangles=membrane.triangles,
    )


def both_sheets(sheet: Sheet, found: Equilibrium) -> tuple[Membrane, Floats]:
    """Return both sheets of a pattern with a mouth, joined along the seam, and where they start.

    The start is the planar equilibrium, bent a little out of its plane. The cut through the trunk
    stays upright and level.
    """
    upper = sheet.membrane
    count = len(upper.points)
    is_seam = np.zeros(count, dtype=np.bool_)
    is_seam[sheet.is_seam] = True
    twin = np.arange(count)
    twin[~is_seam] = count + np.arange(np.count_nonzero(~is_seam))
    points = np.concatenate([upper.points, upper.points[~is_seam]])
    # Seen from below, corners run the other way round.
    triangles = np.concatenate([upper.triangles, twin[upper.triangles][:, ::-1]])
    free = np.concatenate([upper.free, upper.free[~is_seam]])
    at_mouth = is_seam & ~upper.free[:, 0]
    free[:count][is_seam & ~at_mouth, 2] = True
    lower = found.positions[~is_seam] * (1.0, 1.0, -1.0)
    start = np.concatenate([found.positions, lower])
    from_mouth = start[:, 0] - start[:count][at_mouth, 0].mean()
    start[:, 2] += np.where(free[:, 2], _SEED * from_mouth**2, 0.0)
    hoop_strain = 1.0 / (np.pi * upper.stiffness)
    membrane = Membrane(points, triangles, free, hoop_strain=hoop_strain, poisson=upper.poisson)
    return membrane, start
