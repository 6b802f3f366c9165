"""What a design's pattern becomes under pressure, held against the design."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError, UnfitInputError, VinefabError
from vinefab.core.plain_text import GENERATOR, counted, one_line, rounded
from vinefab.core.progress import each, phase
from vinefab.core.validation import Floats, Ints
from vinefab.core.view import (
    Answer,
    Block,
    Data,
    Fact,
    Facts,
    Notes,
    Number,
    Origin,
    Picture,
    Result,
    Rows,
    Section,
    Value,
)
from vinefab.inflation.joint import FreeJoint, free_joint
from vinefab.inflation.mesh import tube_stretch
from vinefab.inflation.pattern import (
    ASSUMED_PRESSURE_KPA,
    MOST_STRAIN,
    Pattern,
    pattern_blocks,
    pattern_of,
    strain_of,
    stretch_of,
)
from vinefab.inflation.robot import ACROSS, InflatedRobot, inflated_robot, with_short_tail
from vinefab.model.design import Design
from vinefab.model.laser import LaserProfile, Material
from vinefab.model.quantity import Standing
from vinefab.outline.body_outline import FlatLayout, body_outline, flat_layout
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    ALERT,
    INK,
    LEVEL_COLOURS,
    ROCK,
    ROCK_EDGE,
    Ink,
    Page,
    Shape,
    page_of_rows,
    plan_panel,
)
from vinefab.pages.plan import page_bytes
from vinefab.physics.tube import hoop_strain
from vinefab.rig.part import RigPart
from vinefab.rig.part_files import PartFileSpec, PartItem, stl_bytes, threemf_bytes

LEFT_OUT = (
    "contact of branches with each other",
    "bending stiffness of film and of the welded band (at most 3 degrees)",
    "gravity",
    "plasticity and creep of the film",
    "folded film inside the tube",
    "bowing out of the plane: free in space, joints of film that stretches by less than about 3 % "
    "bow by 10 to 30 degrees, softer ones hardly (--free)",
)
"""What the simulation does not know."""

MOST_CORNERS = 200_000
"""Of a simulated pattern: 2 GB of memory and about a minute."""

_OTHER = {"inflation": "none", "none": "inflation"}
_HOW = {
    "inflation": "compensated",
    "none": "cut with its designed angles and lengths",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DeployedPattern:
    """A pattern under pressure, and the design that it should become.

    Parameters
    ----------
    pattern
        The flat tree that is cut.
    robot
        Its deployed shape (simulated).
    designed
        Where the design's branches lie.
    tip_errors_mm
        How far each leaf's end is from where it was designed, shape (leaves,).
    seen
        The deployed body seen from above.
    overlap_mm2
        Area where the body lies on itself: siblings pass through each other in the simulation.
    """

    pattern: Pattern
    robot: InflatedRobot
    designed: FlatLayout
    tip_errors_mm: Floats
    seen: BaseGeometry
    overlap_mm2: float

    @classmethod
    def of(cls, design: Design, profile: LaserProfile, across: int) -> "DeployedPattern":
        """Simulate the pattern that a design is cut as.

        Raises
        ------
        BadInputError
            If a joint cannot be solved, or the pattern crosses itself on the sheet.
        NotConvergedError
            If no equilibrium is found.
        """
        pattern = pattern_of(design, profile)
        for joint in pattern.joints:
            if joint.problem:
                # The triangles' own words say nothing to the designer.
                why = joint.problem.partition(": outline is")[0]
                remedy = (
                    f"change the angle or the number of branches of {joint.name}, make it "
                    "narrower, give its fillet another radius, or lower the pressure"
                )
                problem = f"its joints do not deploy as designed: {why}"
                raise UnfitInputError(f"design {design.name}", problem, remedy)
        strain = strain_of(design, profile.material, design.build.widths_mm[0])
        with phase("whole body under pressure"):
            robot = inflated_robot(pattern.flat, hoop_strain=strain, across=across)
        ring = shapely.Polygon(robot.positions_mm[robot.sheet.mesh.seam, :2])
        seen: BaseGeometry = ring
        overlap_mm2 = 0.0
        if not ring.is_valid:
            triangles = robot.positions_mm[robot.sheet.mesh.triangles][:, :, :2]
            seen = shapely.union_all(shapely.polygons(triangles))
            # Of a ring that crosses itself, what it goes around twice counts twice.
            x, y = shapely.get_coordinates(ring.exterior).T
            around_mm2 = float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum() / 2.0)
            overlap_mm2 = max(0.0, around_mm2 - seen.area)
        designed = flat_layout(design)
        return cls(
            pattern=pattern,
            robot=robot,
            designed=designed,
            tip_errors_mm=robot.tip_errors_mm(designed),
            seen=seen,
            overlap_mm2=overlap_mm2,
        )

    @property
    def how(self) -> str:
        """How it was cut, as text."""
        return _HOW[self.pattern.design.build.compensation]

    @property
    def mean_mm(self) -> float:
        """Mean distance of the tips from where they were designed."""
        return float(self.tip_errors_mm.mean())

    @property
    def largest_mm(self) -> float:
        """Largest distance of a tip from where it was designed."""
        return float(self.tip_errors_mm.max())

    def facts(self, key: str) -> tuple[Fact, ...]:
        """Return how far off the tips are."""
        leaves = counted(len(self.tip_errors_mm), "tip")
        mean, largest = (
            Number(value, "mm", ".1f", decimals=3) for value in (self.mean_mm, self.largest_mm)
        )
        return (
            Fact(f"tips off, {self.how}", mean, f"{key}.mean_mm", f"mean of {leaves} (simulated)"),
            Fact("the farthest", largest, f"{key}.largest_mm", "simulated"),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class InflatedDesign(Result):
    """A design's pattern under pressure (simulated), held against the design.

    Parameters
    ----------
    design, profile
        What is inflated, and the recipe whose film it is made of.
    deployed
        The deployed shape of the pattern that is cut.
    other
        That of the other choice of ``[build] compensation``; None if it was left out.
    free
        The joint that children of each level sprout from, free to bow, by their level; for studies.
    notes
        What a user should know, a sentence each.
    origin
        What it takes to get the result again.
    """

    design: Design
    profile: LaserProfile
    deployed: DeployedPattern
    other: DeployedPattern | None = None
    free: Mapping[int, FreeJoint] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    origin: Origin | None = None
    schema = "vinefab/inflation-1"

    @property
    def title(self) -> str:
        """What was asked."""
        return f"{self.design.name} under pressure"

    @property
    def pattern(self) -> Pattern:
        """The flat tree that is cut, and the deployed angles of every joint."""
        return self.deployed.pattern

    @property
    def robot(self) -> InflatedRobot:
        """The deployed shape (simulated)."""
        return self.deployed.robot

    @property
    def tip_errors_mm(self) -> Floats:
        """How far each leaf's end is from where it was designed, shape (leaves,)."""
        return self.deployed.tip_errors_mm

    @property
    def pressure_kpa(self) -> float:
        """The working pressure."""
        return self.design.build.pressure_kpa or ASSUMED_PRESSURE_KPA

    @property
    def surface(self) -> tuple[Floats, Ints]:
        """Corners in mm and triangles of the deployed body, a closed surface."""
        return closed_surface(self.robot)

    def view(self) -> Iterator[Block]:
        """Yield how far tips are off, a picture, and each level's angles, lengths and loads."""
        found, other = self.deployed, self.other
        held = "" if other is None else f"; {other.how} {_off_words(other)}"
        yield Answer(
            f"{self.design.name} at {self.pressure_kpa:g} kPa, {found.how}: tips end "
            f"{_off_words(found)} from where they are designed{held} (simulated).",
            tone="plain" if other is None or found.mean_mm <= other.mean_mm else "caution",
        )
        yield Picture(
            image=lambda: page_svg(inflation_sheet(self)),
            caption="Seen from above: the flat pattern, its deployed shape, and the design. Lines "
            "lead from designed to deployed tips (simulated).",
        )
        yield Notes(self.notes, "notes")
        against = () if other is None else other.facts("other")
        yield Facts((*found.facts("tips"), *against), lead=True)
        tree, turned_deg = self.robot.layout.tree, np.degrees(self.robot.deployed_offsets_rad)
        in_robot_deg = {  # the mean angle of each child within the whole robot, by kind of joint
            place: turned_deg[np.isin(tree.parent, joint.rows)]
            .reshape(-1, len(joint.wanted_deg))
            .mean(axis=0)
            for place, joint in enumerate(self.pattern.joints)
        }
        yield from pattern_blocks(self.pattern, in_robot_deg)
        if self.free:
            yield self._bows()
        yield self._tubes()
        film, robot = self.profile.material, self.robot
        set_by = "of the design" if self.design.build.pressure_kpa else "assumed"
        unit_mm = float(robot.layout.width_mm[0])
        gas = 2.0 * robot.sheet.membrane.volume(robot.equilibrium.positions) * unit_mm**3
        modulus = f"E {film.modulus_mpa.value:g} MPa, {film.modulus_mpa.standing}"
        yield Facts(
            (
                Fact("pressure", Number(self.pressure_kpa, "kPa", "g"), "pressure_kpa", set_by),
                Fact("film", f"{film.ply_mm.value * 1000:g} um {film.title}", "", modulus),
                Fact(
                    "gas", Number(gas / 1000.0, "ml", ".0f", decimals=3), "volume_ml", "simulated"
                ),
            )
        )
        yield Notes((f"Not simulated: {'; '.join(LEFT_OUT)}.",))
        yield Data(self._content)
        rows = list[tuple[Value, ...]]()
        for name, numbers in self._tips():
            rows.append((name, *(Number(value, form="z.1f") for value in numbers)))
        table = Rows(
            caption="Where tips are designed and where they end, in mm from the base (simulated)",
            headings=("branch", "designed x", "designed y", "deployed x", "deployed y", "off"),
            rows=tuple(rows),
        )
        yield Section(title="Tips", tables=(table,), folded=True)

    def picture(self, suffix: str) -> bytes:
        """Return the picture as ``.png`` or ``.svg``."""
        return page_bytes(self.drawing(), suffix)

    def drawing(self) -> Page:
        """Return the same as a page."""
        return inflation_sheet(self)

    def mesh(self, suffix: str) -> bytes:
        """Return the deployed body as a closed surface in mm: .stl, .obj, .3mf or .ply."""
        write = SURFACE_FORMATS.get(suffix.lower())
        if write is None:
            raise BadInputError("suffix", suffix, ", ".join(SURFACE_FORMATS))
        return write(*self.surface, self.design.name)

    def _bows(self) -> Rows:
        """Return how far joints bow where nothing holds them in their plane."""
        rows = list[tuple[Value, ...]]()
        for place, joint in self.free.items():
            kind = self.pattern.joints[place]
            width_mm, level = kind.width_mm, kind.level
            freed_mj = joint.gain * self.pressure_kpa * (width_mm / 10.0) ** 3  # kPa cm3
            rows.append(
                (
                    level,
                    Number(float(joint.bow_deg.max()), form="z.1f", decimals=3),
                    Number(freed_mj, form="z.3f", decimals=6),
                )
            )
        return Rows(
            caption="Joints free in space, for studies: how far children lean out of the plane of "
            "trunk and seam, and the energy that it frees, which lifting a branch takes up "
            "(simulated, one joint at a time)",
            headings=("children on level", "bow deg", "freed mJ"),
            rows=tuple(rows),
            key="free",
            keys=("level", "bow_deg", "freed_mj"),
        )

    def _tubes(self) -> Rows:
        """Return strain, diameter and growth in length of straight tubes, by level and width."""
        design, film, rows = self.design, self.profile.material, list[tuple[Value, ...]]()
        by_level = design.branches is None
        for one in design.tubes:
            width_mm = one.width_mm
            around = tube_stretch(strain_of(design, film, width_mm))[0]
            rows.append(
                (
                    one.level if by_level else one.name,
                    Number(width_mm, form=".1f"),
                    Number(_strain(design, film, width_mm), "%", ".1f", per=0.01, decimals=4),
                    Number(2.0 * width_mm * around / np.pi, form=".1f", decimals=3),
                    Number(stretch_of(design, film, width_mm) - 1.0, "%", ".1f", per=0.01,
                           decimals=4),
                )
            )  # fmt: skip
        modulus, kind = film.modulus_mpa, "level" if by_level else "branches"
        return Rows(
            caption=f"Straight tubes: hoop strain p W / (pi E t) with E {modulus.value:g} MPa "
            f"({modulus.standing}), and its effect on the film (computed)",
            headings=(kind, "flat mm", "hoop strain", "diameter mm", "longer by"),
            rows=tuple(rows),
            key="tubes",
            keys=(kind, "flat_mm", "hoop_strain", "diameter_mm", "longer_by"),
        )

    def _tips(self) -> list[tuple[str, tuple[float, ...]]]:
        """Return each leaf with its designed and its deployed end, and how far it is off."""
        designed = self.deployed.designed
        leaves = np.flatnonzero(designed.is_leaf)
        numbers = np.column_stack(
            [designed.end_mm[leaves], self.robot.ends_mm[leaves], self.tip_errors_mm]
        )
        names = (designed.tree.ids[leaf] for leaf in leaves.tolist())
        return [(name, tuple(row)) for name, row in zip(names, numbers.tolist(), strict=True)]

    def _content(self) -> dict[str, object]:
        """Return the values that stand in JSON alone."""
        film = self.profile.material
        content = {
            "design": self.design.name,
            "recipe": self.profile.recipe.name,
            "compensation": self.design.build.compensation,
            "standing": {"shape": "simulated", "modulus": str(film.modulus_mpa.standing)},
            "modulus_mpa": film.modulus_mpa.value,
            "film_mm": film.ply_mm.value,
            "hoop_strain": round(_strain(self.design, film, self.design.build.widths_mm[0]), 5),
            "overlap_mm2": round(self.deployed.overlap_mm2, 3),
            "not_simulated": list(LEFT_OUT),
            "tips.each": [
                {"branch": name, **rounded(dict(zip(_TIP_KEYS, numbers, strict=True)), 3)}
                for name, numbers in self._tips()
            ],
        }
        if self.other is not None:
            content["other.compensation"] = self.other.pattern.design.build.compensation
        return content


_TIP_KEYS = ("designed_x_mm", "designed_y_mm", "deployed_x_mm", "deployed_y_mm", "off_mm")


def _strain(design: Design, film: Material, width_mm: float) -> float:
    """Return the hoop strain of a straight tube as it is, not rounded or limited."""
    pressure_kpa = design.build.pressure_kpa or ASSUMED_PRESSURE_KPA
    return hoop_strain(pressure_kpa, width_mm, film.ply_mm.value, film.modulus_mpa.value)


def _off_words(found: DeployedPattern) -> str:
    return f"{found.mean_mm:.1f} mm ({found.largest_mm:.1f} at most)"


def inflate_design(
    design: Design,
    profile: LaserProfile,
    *,
    alone: bool = False,
    free: bool = False,
    across: int = ACROSS,
) -> InflatedDesign:
    """Return a design's pattern under pressure.

    Parameters
    ----------
    alone
        Leave out the pattern of the other choice of compensation.
    free
        Simulate each joint free in space too.
    across
        Triangles across a tube, even.

    Raises
    ------
    BadInputError
        If a joint cannot be solved, or the pattern crosses itself on the sheet.
    NotConvergedError
        If no equilibrium is found.
    """
    layout = flat_layout(with_short_tail(design))
    tubes = float((layout.tree.length_mm / layout.width_mm).sum()) + 2.0  # lengths in widths
    most = int((MOST_CORNERS / tubes) ** 0.5) // 2 * 2
    if across > most >= 4:
        raise BadInputError("across", across, f"4 to {most} for {design.name}: memory")
    if most < 4:
        problem = f"{MOST_CORNERS:,} corners of triangles do not fill it"
        raise UnfitInputError(f"design {design.name}", problem, "make fewer or shorter branches")
    notes, other = [], None
    deployed = DeployedPattern.of(design, profile, across)
    choice = _OTHER[design.build.compensation]
    if not alone:
        changed = design.changed(build=design.build.changed(compensation=choice))
        try:
            with phase(f"the pattern {_HOW[choice]}"):
                other = DeployedPattern.of(changed, profile, across)
        except VinefabError as error:
            notes.append(f"{_HOW[choice]}, it cannot be inflated: {error}")
    film = profile.material
    strain = _strain(design, film, design.build.widths_mm[0])
    if strain > MOST_STRAIN:
        notes.append(
            f"hoop strain {100 * strain:.0f} % is simulated as {100 * MOST_STRAIN:.0f} %: no film "
            "stays elastic there"
        )
    if film.modulus_mpa.standing is Standing.ASSUMED:
        notes.append("the film's modulus is assumed, and so is how far it stretches")
    if design.build.pouch is not None:
        notes.append("pouches pull their ends back farther than plain tips: not compensated")
    if deployed.overlap_mm2 > 0.0:
        notes.append(
            f"the deployed body overlaps itself on {deployed.overlap_mm2:.0f} mm2: there branches "
            "press against each other, which is not simulated"
        )
    joints, bowed = deployed.pattern.joints if free else (), dict[int, FreeJoint]()
    for place, joint in enumerate(each("joints free in space", joints)):
        if joint.found is not None:
            bowed[place] = free_joint(joint.found.flat, across=across)
    return InflatedDesign(
        design=design,
        profile=profile,
        deployed=deployed,
        other=other,
        free=bowed,
        notes=tuple(notes),
    )


# --- Pictures -----------------------------------------------------------------------------------

_CUT = Ink(fill=ROCK, fill_alpha=0.45, line=ROCK_EDGE, width_pt=0.6)
_BODY = Ink(fill=LEVEL_COLOURS[5], fill_alpha=0.55, line=LEVEL_COLOURS[0], width_pt=0.9)
_DESIGNED = Ink(line=INK, width_pt=0.7)
_OFF = Ink(line=ALERT, width_pt=1.2)


def inflation_sheet(found: InflatedDesign) -> Page:
    """Return the deployed shape over pattern and design, next to that of the other choice."""
    shapes = [found.deployed, *([] if found.other is None else [found.other])]
    outlines = [
        body_outline(with_short_tail(one.pattern.flat)).contour.flattened_mm() for one in shapes
    ]
    corners = np.concatenate(
        [*outlines, *(np.array(one.seen.bounds).reshape(2, 2) for one in shapes)]
    )
    (x0, y0), (x1, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    panels = []
    plan_pt = 340.0
    for shape, outline in zip(shapes, outlines, strict=True):
        panel = plan_panel((x0, y0, x1, y1), plan_pt)
        panel.title = (
            f"{found.design.name} at {found.pressure_kpa:g} kPa\n{shape.how}\n"
            f"tips off {_off_words(shape)} (simulated)"
        )
        panel.legend_shown = False
        panel.add(Shape([outline], _CUT, closed=True), 1.0, "flat, as cut")
        panel.polygons([shape.seen], _BODY, rank=2.0, label="deployed")
        designed = shape.designed
        ends = np.stack([designed.start_mm, designed.end_mm], axis=1)
        panel.lines(list(ends), _DESIGNED, rank=3.0, label="designed")
        leaves = designed.is_leaf
        tips = np.stack([designed.end_mm[leaves], shape.robot.ends_mm[leaves]], axis=1)
        panel.lines(list(tips), _OFF, rank=4.0, label="tip: from designed to deployed")
        panel.marks(tips[:, 1], "o", 3.0, Ink(fill=ALERT), rank=4.5)
        worst = int(np.argmax(shape.tip_errors_mm))
        panel.write_labels(
            tips[worst : worst + 1, 1], [f"{shape.largest_mm:.1f} mm"], [ALERT], size_pt=7.5,
            lines=[*ends, *tips, *map(shapely.get_coordinates, shapely.get_rings(shape.seen))],
        )  # fmt: skip
        panels.append(panel)
    # A plan that is wider than high stands above the other one.
    rows = [[panel] for panel in panels] if x1 - x0 > 1.3 * (y1 - y0) else [panels]
    return page_of_rows(rows, legend=panels[0].legend)


# --- The closed surface of an inflated pattern, and files that viewers of 3-D shapes read (mm) ----


def closed_surface(robot: InflatedRobot) -> tuple[Floats, Ints]:
    """Return corners in mm, shape (n, 3), and triangles, counter-clockwise from outside.

    The lower sheet is the mirror image of the upper one, which has the same corners on the seam;
    a flat lid closes the mouth.
    """
    mesh, upper = robot.sheet.mesh, robot.positions_mm
    on_seam = ~robot.sheet.membrane.free[:, 2]
    count = len(upper)
    off_seam = np.flatnonzero(~on_seam)
    below = np.arange(count)
    below[off_seam] = count + np.arange(len(off_seam))
    vertices = np.concatenate([upper, upper[off_seam] * (1.0, 1.0, -1.0)])
    vertices[:count][on_seam, 2] = 0.0
    # A triangle whose corners all lie on the seam is flat, and its own mirror image.
    triangles = mesh.triangles[~on_seam[mesh.triangles].all(axis=1)]
    faces = [triangles, below[triangles][:, ::-1]]
    ahead = np.roll(mesh.seam, -1)
    mouth = ~(on_seam[mesh.seam] & on_seam[ahead])
    if mouth.any():
        one, two = mesh.seam[mouth], ahead[mouth]
        rim = np.unique(np.concatenate([one, two]))
        middle = upper[rim].mean(axis=0) * (1.0, 1.0, 0.0)
        center = np.full(len(one), len(vertices))
        vertices = np.concatenate([vertices, middle[None]])
        faces += [
            np.column_stack([two, one, center]),
            np.column_stack([below[one], below[two], center]),
        ]
    return vertices, np.concatenate(faces)


def volume_mm3(vertices_mm: Floats, faces: Ints) -> float:
    """Return the volume within a closed surface."""
    a, b, c = (vertices_mm[faces[:, corner]] for corner in range(3))
    return float((np.cross(a, b) * c).sum() / 6.0)


def _threemf(vertices_mm: Floats, faces: Ints, name: str) -> bytes:
    single = np.asarray(vertices_mm, dtype=np.float32).astype(np.float64)
    part = RigPart(
        name=name,
        vertices_mm=single,
        faces=faces,
        to_map=np.eye(4),
        volume_mm3=volume_mm3(vertices_mm, faces),
    )
    return threemf_bytes(PartFileSpec(items=[PartItem(part=part)], title=name))


def _obj(vertices_mm: Floats, faces: Ints, name: str) -> bytes:
    lines = [f"# {GENERATOR}: {one_line(name)}, millimetres"]
    lines += [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in vertices_mm.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()


def _ply(vertices_mm: Floats, faces: Ints, name: str) -> bytes:
    lines = [
        "ply",
        "format ascii 1.0",
        f"comment {GENERATOR}: {one_line(name)}, millimetres",
        f"element vertex {len(vertices_mm)}",
        *(f"property float {axis}" for axis in "xyz"),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
        *(f"{x:.5f} {y:.5f} {z:.5f}" for x, y, z in vertices_mm.tolist()),
        *(f"3 {a} {b} {c}" for a, b, c in faces.tolist()),
    ]
    return ("\n".join(lines) + "\n").encode()


SURFACE_FORMATS: dict[str, Callable[[Floats, Ints, str], bytes]] = {
    ".stl": stl_bytes,
    ".obj": _obj,
    ".3mf": _threemf,
    ".ply": _ply,
}
"""What writes each ending: corners in mm, triangles and a name as bytes, the same each time."""
