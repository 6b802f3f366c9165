"""The verb that puts a design's pattern under pressure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from vinefab.app.common import context_of, page_path, with_origin, write_page
from vinefab.core.errors import BadInputError
from vinefab.core.verbs import Force, Progress, Within, told, verb
from vinefab.model.inputs import DesignLike, PathText, RecipeLike, written

if TYPE_CHECKING:
    from vinefab.prediction.inflation_report import InflatedDesign


@verb
def inflate(
    design: DesignLike,
    recipe: RecipeLike | None = None,
    *,
    alone: bool = False,
    free: bool = False,
    across: Annotated[int, Within(4, 32)] = 8,
    out: Annotated[PathText | None, written(".html", ".htm", ".svg", ".png")] = None,
    mesh: Annotated[PathText | None, written(".stl", ".obj", ".3mf", ".ply")] = None,
    progress: Progress = True,
    force: Force = False,
) -> InflatedDesign:
    """Show the shape that a design's flat pattern takes under pressure (simulated).

    The pattern is the one that is cut: with ``[build] compensation = "inflation"`` its angles and
    lengths are those that deploy as designed, with "none" they are the designed ones.

    Parameters
    ----------
    alone
        Leave out the other choice of compensation, which takes as long again.
    free
        Simulate each joint without floor and lid too: joints of stiff film bow. For studies.
    across
        Triangles across a tube, an even number; more are slower and finer.
    out
        A page or a picture to write.
    mesh
        The deployed body to write for 3-D viewers, a closed surface in mm.

    Returns
    -------
    InflatedDesign
        The ``robot`` under pressure, the ``pattern``, ``tip_errors_mm``, the ``surface``, and a
        ``summary`` in lines.

    Raises
    ------
    BadInputError
        If a value cannot be used, a joint cannot be solved, or the pattern crosses itself.
    ForeignFileError
        If a file to write is something else.
    UnknownNameError
        If there is no such design or recipe.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab inflate three_level_tree --out inflated.html --mesh inflated.stl

    >>> found = inflate("plain_vine", alone=True)
    >>> found.robot.ends_mm.shape
    (1, 2)
    """
    from vinefab.prediction.inflation_report import inflate_design

    page = page_path("out", out, force=force)
    solid = page_path("mesh", mesh, force=force)
    if across % 2:
        raise BadInputError("across", across, "an even number")
    context = context_of(design, recipe=recipe)
    (robot,), profile = context.robots, context.recipe
    with told("inflate", progress) as tell:
        found = inflate_design(robot, profile, alone=alone, free=free, across=across, progress=tell)
    found = with_origin(found, [robot], [], profile)
    if page is not None:
        is_page = page.suffix.lower() in (".html", ".htm")
        write_page(page, found.page() if is_page else found.picture(page.suffix), force=force)
    if solid is not None:
        write_page(solid, found.mesh(solid.suffix), force=force)
    return found
