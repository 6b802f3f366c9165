"""README.txt of a fabrication package: the steps of the person at the laser."""

import math
from collections.abc import Sequence
from itertools import pairwise
from textwrap import fill

from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import counted, one_line
from vinefab.fabrication.formats.dxf_format import DXF, DXF_POLYLINE
from vinefab.fabrication.formats.laser_drawing import (
    Colours,
    metadata,
    operations_by_style,
    operations_left_out,
    styled_paths,
)
from vinefab.fabrication.formats.laser_formats import LASER_FORMATS, sheet_folder
from vinefab.fabrication.formats.lightburn_format import LIGHTBURN
from vinefab.fabrication.formats.svg_format import SVG
from vinefab.fabrication.job.tile_jobs import TARGET, VERIFICATION, VERIFY
from vinefab.fabrication.package.bom import film_piece_mm
from vinefab.fabrication.package.mounting import mounting_steps
from vinefab.fabrication.package.piece_joining import JoiningWords
from vinefab.model.design import Design
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile, Quantity, RecipeStatus, SealerSettings

_DXF, _POLYLINE, _SVG = (one.file_name() for one in (DXF, DXF_POLYLINE, SVG))
_PROJECT = LIGHTBURN.file_name()
_WIDTH = 96

_MEANING = {
    Operation.MARK: "labels and arrows outside the body; must not cut through",
    Operation.WELD: "seam only: fuses the plies, must not cut through; open at the mouth",
    Operation.WELDCUT: "outline of the robot: one pass fuses the plies and cuts; open at the mouth",
    Operation.CUT: "mouth and sheet: cuts through; at the mouth the plies must stay apart",
    Operation.REG: "registration and scale: never cut, switch the layer off",
    Operation.DOC: "dimensions and notes: never cut, switch the layer off",
}

_OFFSET_ADVICE = (
    "If yours differ by more than 0.1 mm, the files must be made again (end of this section);"
    " do not correct it at the machine."
)

_ABOUT = (
    "Files to cut a vine robot from film: a thin tube with branches that grows at its tips by"
    " turning inside out under pressure. Read sections 1 to 5 before you press start. What is"
    " unclear, ask whoever sent this folder."
)

_STATUS = {
    RecipeStatus.UNVERIFIED: (
        "UNVERIFIED RECIPE. Nobody has reported a good seam with these settings. They are a place"
        " to start a coupon from, not settings to cut a robot with."
    ),
    RecipeStatus.COUPON_OK: (
        "Recipe tried on coupons, not burst-tested. Do not rely on the pressure rating."
    ),
    RecipeStatus.BURST_TESTED: "Recipe burst-tested. Cut one coupon anyway: films and lenses age.",
}


def readme_text(
    design: Design,
    job: Job,
    profile: LaserProfile,
    colours: Colours,
    joining: JoiningWords | None = None,
) -> str:
    """Return the operator's steps for one job, plain text, every number with its standing.

    Parameters
    ----------
    joining
        How the pieces of a robot are joined; None for a robot in one piece.
    """
    title = f"Fabrication package: {design.name}"
    parts = [
        f"{title}\n{'=' * len(title)}",
        _paragraph("", _ABOUT),
        _paragraph("!! ", _STATUS[profile.recipe.status]),
        readme_section("1. Film", _film(job, profile)),
        readme_section("2. Coupon first", _coupon(job, profile, colours)),
        readme_section("3. The file", _file(job, colours)),
        *([readme_section("3a. In tiles", _tiles(job, profile, colours))] if job.tiles else []),
        readme_section(
            "4. Layers, in the order in which they must run", _layers(job, profile, colours)
        ),
        readme_section("5. At the machine", _machine(job, profile, colours)),
        readme_section(
            "6. After cutting: measure", _measure(design, job, profile, whole=joining is None)
        ),
        *([] if joining is None else [_joining(joining)]),
        readme_section("7. Mounting", mounting_steps(design.build)),
        readme_section("8. What the files say about themselves", _facts(job, colours)),
        f"Numbers marked (assumed) were not measured by anyone; see job.json for sources.\n"
        f"{GENERATOR}",
    ]
    return "\n\n".join(parts) + "\n"


def _film(job: Job, profile: LaserProfile) -> list[str]:
    film = profile.material
    width, height = film_piece_mm(job, profile)
    return [
        f"Use {film.title}: {_sheets(job)}{counted(film.plies, 'ply')} of "
        f"{_value(film.ply_mm, 'mm')},"
        " each at least"
        f" {math.ceil(width - 1e-6)} x {math.ceil(height - 1e-6)} mm.",
        "Clean the plies and lay them on each other without folds.",
        "Heat-press them flat before welding, to drive out bubbles and wrinkles. The plies must"
        " still come apart by hand afterwards; lower the temperature if they do not.",
        "Lay the sheet flat into the lower left corner of the bed and hold its rim down."
        if not job.tiles
        else "Roll up what hangs over the bed; hold the sheet down where the laser runs.",
    ]


def _sheets(job: Job) -> str:
    return f"{counted(len(job.sheets), 'sheet')}, each of " if len(job.sheets) > 1 else ""


def _coupon(job: Job, profile: LaserProfile, colours: Colours) -> list[str]:
    steps = [
        "Cut a small closed test piece in the same film with the settings of section 4, at least a"
        " straight seam and one round end.",
        "Right: the rim is fused all around, the piece comes free, the seam holds when pulled."
        " Seam peels: more energy (slower) or more defocus. Rim burns or gapes: less energy.",
        "Measure the kerf (width of the gap) and the width of the fused rim.",
    ]
    written = _written(job, colours)
    return [*steps, *_offsets(profile, written), _made_again(profile, written)]


def _made_again(profile: LaserProfile, written: Sequence[Operation]) -> str:
    """Return how files with another kerf or seam are made."""
    tables = [
        f"[operations.{operation}]" if profile.settings(operation).by_laser else "[sealer]"
        for operation in written
        if operation in (Operation.WELD, Operation.WELDCUT, Operation.CUT)
    ]
    return (
        "Other kerf, other seam: send both numbers to whoever sent this folder, or do it yourself"
        f" with vinefab: they are kerf_mm and seam_width_mm of {' and '.join(tables)} in a copy of"
        f" the recipe {profile.recipe.name}; then: vinefab fabricate design.toml --recipe"
        " your_recipe.toml --out again (and what else made this folder: copies, process). Of many"
        " readings, vinefab coupon and vinefab calibrate"
        " make the recipe."
    )


def _written(job: Job, colours: Colours) -> tuple[Operation, ...]:
    """Return the operations that a package's files hold, in process order."""
    return tuple(op for op in Operation if op in colours.styles and job.along(op))


def _offsets(profile: LaserProfile, written: Sequence[Operation]) -> list[str]:
    """Return the offsets that are in the paths, for the operations whose paths have any."""
    steps = []
    for operation in (op for op in written if op in (Operation.WELD, Operation.WELDCUT)):
        settings = profile.settings(operation)
        offsets = f"a seam of {_value(settings.seam_width_mm, 'mm')}"
        if operation is Operation.WELDCUT:
            offsets = f"a kerf of {_value(settings.kerf_mm, 'mm')} and {offsets}"
        steps.append(f"The {operation} paths are offset for {offsets}. {_OFFSET_ADVICE}")
    if Operation.CUT in written and Operation.WELDCUT not in written:
        kerf = _value(profile.settings(Operation.CUT).kerf_mm, "mm")
        steps.append(f"The cut paths are offset for that seam and a kerf of {kerf}.")
    return steps


def _file(job: Job, colours: Colours) -> list[str]:
    first = job.sheets[0] if job.sheets else job
    size = f"{first.sheet_width_mm:g} x {first.sheet_height_mm:g} mm"
    x0, y0, x1, y1 = _box(first, colours)
    steps = [
        *_folders(job),
        f"Open {_DXF} (true arcs) or {_SVG}. Use {_POLYLINE} only where arcs are"
        " missing after import: some programs ignore them without a word.",
        f"LightBurn: {_PROJECT} has the layers of section 4 with their settings."
        " LightBurn's format is not published: compare power, speed and size"
        f" with section 4 before you run it, and use {_SVG} if anything differs.",
        "If the program asks for a unit, it is millimetres; scale 100 %.",
        f"Check after import{' of sheet 1' if job.sheets else ''}:"
        f" the {'film' if job.tiles else 'bed'} is {size}; all paths together"
        f" measure {x1 - x0:.2f} x {y1 - y0:.2f} mm and begin {x0:.2f} mm from its left and"
        f" {y0:.2f} mm from its lower edge.",
        "Do not join, close, simplify or convert paths: the outline is open at the mouth.",
        "preview.png shows how it should look, animation.svg (open it in a browser) how the beam"
        " runs; report.html and checks.json tell which design rules"
        " were run and what they found; bom.csv counts film and time; job.json holds every"
        " setting, design.toml the robot's design. sha256sum -c MANIFEST.sha256 tells whether a"
        " file was changed.",
    ]
    steps.extend(
        f"{LASER_FORMATS[name].file_name()}: {LASER_FORMATS[name].title}, from {package}."
        for name, package in LASER_FORMATS.packages.items()
        if not LASER_FORMATS[name].on_request
    )
    if min(x0, y0) < 0.0 or x1 > first.sheet_width_mm or y1 > first.sheet_height_mm:
        steps.append("WARNING: the paths reach beyond the bed. Do not scale them to make them fit.")
    return steps


def _folders(job: Job) -> list[str]:
    """Return where the files of a robot in pieces are."""
    if not job.sheets:
        return []
    steps = [
        f"{sheet_folder(number)}/ has the files for pieces {', '.join(labels)}."
        for number, sheet in enumerate(job.sheets, start=1)
        if isinstance(labels := sheet.facts["pieces"], list)
    ]
    return [f"The robot is cut in pieces. {' '.join(steps)} Each sheet is a job of its own."]


def _tiles(job: Job, profile: LaserProfile, colours: Colours) -> list[str]:
    by_laser = any(path.label == TARGET for path in job.along(Operation.MARK))
    makes = "Each tile marks crosses on the film for later tiles."
    if not by_laser:
        makes = (
            "Each tile shows crosses for later tiles on its REG layer: mark them on the film by"
            " hand, by the pointer, before the film moves."
        )
    steps = [
        f"The robot is larger than the bed: run the files tile_1_... to tile_{len(job.tiles)}_..."
        f" in this order, not {_DXF}, which shows the whole.",
        f"For tile 1 the film's lower left corner lies {_corner(job.tiles[0])}.",
        f"{makes} Move the film on without letting the plies slide, then align: the two crosses"
        " drawn on the REG layer of a tile (never cut) must lie on the two marked on the film"
        " (print-and-cut alignment, or by the pointer).",
        _alignment(job, profile, colours),
        "Paths run twice over 12 mm where tiles meet: that is meant.",
    ]
    for tile in job.tiles[1:]:
        facts = tile.facts
        steps.append(
            f"Tile {facts['tile']} is aligned to crosses made with tile {facts['aligned_to_tile']};"
            f" the film's lower left corner is then {_corner(tile)}."
        )
    return steps


def _alignment(job: Job, profile: LaserProfile, colours: Colours) -> str:
    """Return how well a tile must be aligned, and how that is verified before it is run."""
    seam = min(
        profile.settings(operation).seam_width_mm.value
        for operation in (Operation.WELD, Operation.WELDCUT)
        if job.along(operation)
    )
    verify = "Verify it before a tile is run: let the pointer go along the two crosses"
    if Operation.MARK in colours.styles and any(
        path.label == VERIFICATION for path in job.along(Operation.MARK)
    ):
        layer = f"{colours.styles[Operation.MARK].layer}_{VERIFY}"
        verify = (
            f"Verify it: run the layer {layer} of a tile first and alone. It marks a diagonal cross"
            " on each of the two crosses; where the middles of the two differ by more than the"
            " tolerance, align again and judge by the newest mark. Then let the pointer go along"
            " the two crosses"
        )
    return (
        f"Tolerance: both crosses, and the ends of the paths of the tile before, must lie within"
        f" {seam / 2.0:.2g} mm (half the seam, computed) of where the file has them, or the seam"
        f" may leak where the tiles meet. {verify} and along the last 12 mm of the paths that are"
        " there already."
    )


def _corner(tile: Job) -> str:
    """Return the place of the film's lower left corner while a tile is cut."""
    x, y = (-float(str(tile.facts[f"window_{axis}_mm"])) for axis in "xy")
    return (
        f"{abs(x):.0f} mm {'left' if x < 0 else 'right'} of the bed's lower left corner and"
        f" {abs(y):.0f} mm {'below' if y < 0 else 'above'} it"
    )


def _layers(job: Job, profile: LaserProfile, colours: Colours) -> list[str]:
    lines = []
    for operation in Operation:
        style = colours.styles.get(operation)
        if style is None or not job.along(operation):
            continue
        paths = [path for path in job.along(operation) if path.label != VERIFICATION]
        verifying = len(job.along(operation)) - len(paths)
        if verifying:
            lines.append(
                f"{style.layer}_{VERIFY}, a colour of its own: diagonal crosses of {verifying}"
                f" lines that verify where a tile lies (section 3a). Settings of {style.layer}."
            )
        count, length = len(paths), sum(path.contour.length_mm for path in paths)
        text = f"{style.layer}, colour {style.rgb} (DXF {style.aci}): {_MEANING[operation]}."
        text += f" {counted(count, 'path')}, {length:.0f} mm."
        if operation.is_machined:
            text += f" {_settings(profile, operation)}"
        lines.append(text)
    return lines


def _settings(profile: LaserProfile, operation: Operation) -> str:
    settings = profile.settings(operation)
    if isinstance(settings, SealerSettings):
        numbers = (
            f"seam {_value(settings.seam_width_mm, 'mm')} wide",
            _value(settings.temperature_c, "degrees C"),
            _value(settings.dwell_s, "s"),
        )
        return (
            f"NOT FOR THE LASER: switch this layer off and seal along these lines with an impulse"
            f" sealer: {', '.join(numbers)}."
        )
    return (
        f"Power {_value(settings.power_percent, '%')}, in corners"
        f" {_value(settings.min_power_percent, '%')}, speed {_value(settings.speed_mm_s, 'mm/s')},"
        f" {settings.passes} pass{'es' if settings.passes > 1 else ''}, focus offset"
        f" {_value(settings.focus_offset_mm, 'mm')}, {_value(settings.frequency_hz, 'Hz')},"
        f" air assist {'on' if settings.air_assist else 'off'}."
    )


def _machine(job: Job, profile: LaserProfile, colours: Colours) -> list[str]:
    machine = profile.machine
    steps = [
        f"The settings are for: {machine.title}, {_value(machine.power_w, 'W')}. Another machine"
        " needs its own recipe.",
        "Leave kerf, offset and beam compensation at 0: seam and kerf are in the paths already.",
        "Keep the order of section 4 and switch off any sorting of paths: once the sheet is cut"
        " free, the film moves.",
        *_repeats(job, profile),
        *_focus_changes(job, profile, colours),
    ]
    steps.extend(
        f"WARNING: {' and '.join(group)} have the same layer and colour here and run with one"
        " setting. The mouth may be welded shut: trim it open by hand"
        f"{', and plugs and sockets as section 6a says' if job.sheets else ''}."
        for group in operations_by_style(job, colours)
        if len(group) > 1
    )
    missing = operations_left_out(job, colours)
    if missing:
        steps.append(
            f"The colour preset {colours.name} does not write: {', '.join(missing)}. The lengths"
            " and settings of these are in job.json."
        )
    steps.append("TPU fumes are harmful: run the extraction, and never leave the laser alone.")
    return steps


def _repeats(job: Job, profile: LaserProfile) -> list[str]:
    """Return the operations that take several passes."""
    several = [
        f"{operation} {settings.passes} times"
        for operation in Operation
        if operation.is_machined and job.along(operation)
        if (settings := profile.settings(operation)).by_laser and settings.passes > 1
    ]
    if not several:
        return []
    return [
        "Every path is in the DXF and SVG files once; let the program run"
        f" {' and '.join(several)} ({_PROJECT} says so already)."
    ]


def _focus_changes(job: Job, profile: LaserProfile, colours: Colours) -> list[str]:
    """Return between which layers the focus must be changed, if it must."""
    written = _written(job, colours)
    layers = [
        (colours.styles[operation].layer, settings.focus_offset_mm.value)
        for operation in written
        if operation.is_machined and (settings := profile.settings(operation)).by_laser
    ]
    changes = [
        f"from {before:g} to {after:g} mm between {one} and {two}"
        for (one, before), (two, after) in pairwise(layers)
        if before != after
    ]
    if not changes:
        return []
    return [
        f"Set the focus offset to {layers[0][1]:g} mm for {layers[0][0]}, then change it by hand"
        f" {', '.join(changes)}: run these layers one at a time, and do not move the film."
    ]


def _measure(design: Design, job: Job, profile: LaserProfile, *, whole: bool) -> list[str]:
    inflate = (
        f"Inflate slowly behind a shield, first to a quarter of {design.build.pressure_kpa:g} kPa"
        " (working pressure of the design)."
    )
    if not whole:
        inflate = "Inflate only what is closed but for its base: section 6a says when."
    widths = ", ".join(f"level {i} {w:g}" for i, w in enumerate(design.build.widths_mm, start=1))
    return [
        f"Inner lay-flat width between the seams, in mm: {widths}.",
        "Open the mouth with a blunt tool; if it is fused, trim it back by a few millimetres.",
        "Look along the seam at crotches and tips first: that is where it fails.",
        f"{inflate} Known of the seam:"
        f" {profile.material.seam.words()}, lay-flat; a wider tube holds less.",
        f"Write down: kerf, seam width, widths, burst pressure; recipe {profile.recipe.name}, job"
        f" {job.name}.",
    ]


def _joining(joining: JoiningWords) -> str:
    """Return the section on joining the pieces: what every joint takes, and the steps by number."""
    return "\n".join(
        [
            readme_section("6a. Joining the pieces", joining.needed),
            "",
            "Every joint is made like this:",
            *_numbered(joining.one_joint, [f"{chr(ord('a') + row)}." for row in range(26)]),
            "",
            "Steps:",
            *_numbered(joining.steps, [f"{row}." for row in range(1, len(joining.steps) + 1)]),
        ]
    )


def _numbered(items: Sequence[str], numbers: Sequence[str]) -> list[str]:
    wide = len(numbers[len(items) - 1])
    return [
        _paragraph(f"{number:>{wide}} ", item) for number, item in zip(numbers, items, strict=False)
    ]


def _facts(job: Job, colours: Colours) -> list[str]:
    shown = ("generator", "name", "units", "sheet_mm", "kerf")
    facts = {key: str(one) for key, one in metadata(job, colours).items() if key not in shown}
    lists = [key for key, value in facts.items() if value.startswith(("[{", "{"))]
    lines = [f"{key}: {value}" for key, value in facts.items() if key not in lists]
    return [*lines, f"{', '.join(lists)}: in job.json"] if lists else lines


def _box(job: Job, colours: Colours) -> tuple[float, float, float, float]:
    boxes = [styled.path.contour.box_mm for styled in styled_paths(job, colours)]
    low_x, low_y, high_x, high_y = zip(*boxes, strict=True)
    return min(low_x), min(low_y), max(high_x), max(high_y)


def readme_section(title: str, items: Sequence[str]) -> str:
    """Return a section of a README: underlined title and wrapped items."""
    return "\n".join([title, "-" * len(title), *(_paragraph("- ", item) for item in items)])


def _paragraph(lead: str, text: str) -> str:
    return fill(
        one_line(text),
        width=_WIDTH,
        initial_indent=lead,
        subsequent_indent=" " * len(lead),
        break_on_hyphens=False,
        break_long_words=False,
    )


def _value(quantity: Quantity, unit: str) -> str:
    return f"{quantity.words()} {unit} ({quantity.standing})"
