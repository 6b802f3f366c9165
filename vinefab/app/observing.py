"""Verbs about photos of grown robots: one seen, and several fitted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from vinefab.app.common import context_of, ensure_apart, page_path, write_page
from vinefab.core.errors import BadInputError
from vinefab.core.verbs import Force, Kind, Within, also, verb
from vinefab.model.inputs import (
    DesignLike,
    GrowthLike,
    MapLike,
    PathText,
    PoseLike,
    as_map,
    as_path,
    as_several,
    as_tuple,
    several_numbers,
    written,
)

if TYPE_CHECKING:
    from vinefab.observation.contact_fit import ContactFit
    from vinefab.observation.observe_photo import Observation


@verb
def observe(
    photo: Annotated[PathText, Kind(metavar="PHOTO")],
    map: MapLike,
    design: DesignLike,
    pose: PoseLike | None = None,
    *,
    rig: PathText | None = None,
    corners_px: Annotated[
        tuple[float, ...] | None, several_numbers("X,Y,X,Y,..."), also("--corners")
    ] = None,
    obstacle_height_mm: Annotated[float | None, also("--obstacle-height")] = None,
    film_colour: Annotated[tuple[int, int, int] | None, several_numbers("R,G,B")] = None,
    outline: PathText | None = None,
    growth: GrowthLike | None = None,
    results: PathText | None = None,
    pressure_kpa: Annotated[float, Within(0.1, 1000.0, "kPa")] = 20.0,
    out: Annotated[PathText | None, written(".html", ".htm", ".json")] = None,
    force: Force = False,
) -> Observation:
    """Trace a grown robot on a photo from above (measured) and compare it with its prediction.

    Parameters
    ----------
    photo
        A photo from above, JPEG or PNG.
    map
        The map that the rig was made from, or the path of its file.
    rig
        The rig's ``rig.json``: where its markers lie and how high its obstacles are. Without it,
        markers are looked for where `rig` puts them.
    corners_px
        Instead of markers: column and row of the lower left, lower right, upper right and upper
        left corner of the bounds' box in the photo, eight numbers.
    obstacle_height_mm
        Height of the obstacles, which hide what lies behind them.
    film_colour
        Red, green and blue of the film, 0 to 255; default: as it is at the base.
    outline
        The film outlined by hand: GeoJSON in map millimetres, or SVG in pixels of the photo.
    growth
        Growth options of the prediction by name: pressure_stop=false.
    results
        Of a photo of a joint coupon: the table, from `coupon`, that its angle is entered in for
        `calibrate`. ``design`` is the coupon's name then, PAIR-80-W20.
    pressure_kpa
        Pressure in the joint coupon.
    out
        A page (.html) to write, or the numbers (.json), which `fit_observations` reads.

    Returns
    -------
    Observation
        A ``summary`` in lines, all ``numbers``, and the ``path`` of the written file.

    Raises
    ------
    BadInputError
        If a value cannot be used, no markers are seen, or no film is found.
    ForeignFileError
        If ``out`` is something else.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab observe examples/arena/grown_1.jpg --map arena.geojson
      --design examples/arena/sprig.toml --pose 152,132,2 --obstacle-height 30 --json seen.json

    >>> coupon = ("joints.jpg", "coupons/joints_W20.geojson", "PAIR-80-W20")
    >>> seen = observe(*coupon, results="coupons/results.csv")  # doctest: +SKIP

    >>> seen = observe("photo.jpg", "grid.geojson", "grid_explorer")  # doctest: +SKIP
    >>> seen.numbers["summary"]["shape_error_mm"]  # doctest: +SKIP
    """
    from vinefab.model.map import Map, Pose
    from vinefab.observation.observe_photo import PhotoSetup, observe_photo
    from vinefab.photos.photo import read_photo
    from vinefab.prediction.deploy import as_grown, first_start

    page = page_path("out", out, force=force)
    picture = as_path("photo", photo)
    if page is not None:
        ensure_apart("out", page, picture, "the photo")
    world = as_map(map)
    if results is not None:
        from vinefab.fabrication.calibration.coupons import joint_coupon

        design = joint_coupon(str(getattr(design, "name", design)))
    context = context_of(design, growth=growth)
    robot = as_grown(context.robots[0], context.recipe)
    eight, three = (
        "columns and rows of four corners, eight numbers",
        "red, green and blue, 0 to 255",
    )
    setup = PhotoSetup.of(
        rig=None if rig is None else as_path("rig", rig),
        corners_px=None if corners_px is None else as_tuple("corners_px", corners_px, eight),
        obstacle_mm=obstacle_height_mm,
        film_colour=None if film_colour is None else as_tuple("film_colour", film_colour, three),
        outline=None if outline is None else as_path("outline", outline),
    )
    seen = observe_photo(
        read_photo(picture),
        world,
        robot,
        first_start(world) if pose is None else Pose.of(pose),
        setup,
        growth=context.given,
        map_file=world.name if isinstance(map, Map) else str(map),
        design_file=robot.name if not isinstance(design, str | Path) else str(design),
    )
    if results is not None:
        seen = _with_reading(seen, as_path("results", results), pressure_kpa)
    if page is not None:
        is_json = page.suffix.lower() == ".json"
        write_page(page, seen.json_text() if is_json else seen.page(), force=force)
    return replace(seen, path=page)


def _with_reading(seen: Observation, table: Path, pressure_kpa: float) -> Observation:
    """Enter the angle of a joint coupon in a table of coupon results, which may be a new file."""
    from vinefab.fabrication.calibration.coupon_results import read_results
    from vinefab.model.files.shipped import read_text
    from vinefab.observation.joint_angles import joint_reading

    before = ""
    if table.exists():
        read_results(table)  # nothing is added to a file that `calibrate` does not read
        before = read_text(table, 16 << 20)
    reading = joint_reading(seen, pressure_kpa)
    write_page(table, reading.entered(before), force=True)
    return replace(seen, reading=reading)


@verb
def fit_observations(
    observations: Annotated[PathText | tuple[PathText, ...], Kind(metavar="JSON", several=True)],
    *,
    angle_error_deg: Annotated[float, Within(0.1, 30.0, "deg")] = 2.0,
    out: Annotated[PathText | None, written(".toml"), also("--fit")] = None,
    force: Force = False,
) -> ContactFit:
    """Fit several observations: half-angle, friction of the tip and widths, with 95 % intervals.

    Parameters
    ----------
    observations
        JSON files of observations, one for each photo, in Python also what `observe` returned for
        such ``out``.
    angle_error_deg
        Standard error of the angles of contacts where an observation does not give it (assumed).
    out
        A file to write; predictions read it as ``contacts``.

    Returns
    -------
    ContactFit
        A ``summary`` in lines, all ``numbers``, and the file's ``path``.

    Raises
    ------
    BadInputError
        If a value cannot be used, or the observations say nothing of contacts.
    ForeignFileError
        If ``out`` is something else.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab fit-observations seen.json --out contacts.toml

    >>> fitted = fit_observations(["one.json", "two.json"], out="mine.toml")  # doctest: +SKIP
    >>> fitted.numbers["head_on_half_angle_deg"]["low"]  # doctest: +SKIP
    """
    from vinefab.observation.contact_fit import fit_files

    file = page_path("out", out, force=force)
    paths = [as_path("observations", one) for one in as_several(observations)]
    if not paths:
        raise BadInputError("observations", None, "JSON files of observations")
    for path in paths if file is not None else ():
        ensure_apart("out", file or path, path, "an observation")
    found = fit_files(paths, angle_error_deg)
    if file is not None:
        write_page(file, found.text(), force=force)
    return replace(found, path=file)
