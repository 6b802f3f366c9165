"""What the energy matrix says: between which line energies plies seal, or seal and come apart."""

from collections.abc import Sequence

from vinefab.files.results import Reading, Results
from vinefab.model.job import Operation
from vinefab.model.laser import EnergyWindow, LaserProfile, Quantity, Standing

_MAKES = {Operation.WELD: "weld", Operation.WELDCUT: "weldcut"}
"""What a line of the matrix must have done to be right for an operation."""


def energy_windows(results: Results, profile: LaserProfile) -> tuple[EnergyWindow, ...]:
    """Return the energies that were right, per operation of the recipe and focus offset.

    They are the longest run of neighbouring lines that were right: energies between lines that
    failed are not claimed. Without such a line the window is empty, which is a result too.

    Raises
    ------
    BadInputError
        If a reading's setting is no line energy with a focus offset.
    """
    lines: dict[float, list[tuple[float, str]]] = {}
    for reading in results.of("matrix"):
        energy, focus = _cell(reading)
        lines.setdefault(focus, []).append((energy, reading.word))
    return tuple(
        _window(operation, focus, sorted(found), profile)
        for operation, _ in _MAKES.items()
        if _by_laser(operation, profile)
        for focus, found in sorted(lines.items())
    )


def window_lines(windows: Sequence[EnergyWindow], profile: LaserProfile) -> list[str]:
    """Return windows as lines for the user, and the energies that the recipe runs beside them."""
    told = [window.words() for window in windows]
    for operation in dict.fromkeys(window.operation for window in windows):
        settings = profile.settings(operation)
        energy = settings.line_energy_mj_mm(profile.machine)
        focus = settings.focus_offset_mm.value
        told.append(f"the recipe runs {operation} at {energy:.1f} mJ/mm, focus {focus:g} mm")
    return told


def _by_laser(operation: Operation, profile: LaserProfile) -> bool:
    settings = profile.recipe.operations.get(operation)
    return settings is not None and settings.by_laser


def _window(
    operation: Operation, focus: float, lines: list[tuple[float, str]], profile: LaserProfile
) -> EnergyWindow:
    right = _MAKES[operation]
    best: list[float] = []
    run: list[float] = []
    for energy in sorted({energy for energy, _ in lines}):
        good = all(word == right for at, word in lines if at == energy)
        run = [*run, energy] if good else []
        best = max(best, run, key=len)
    count = sum(word == right for _, word in lines)
    words = f"energy matrix: {count} of {len(lines)} lines, power of {profile.machine.name}"
    least, most = (
        Quantity(value=energy, standing=Standing.MEASURED, source=words) if best else None
        for energy in ((best[0], best[-1]) if best else (0.0, 0.0))
    )
    return EnergyWindow(operation=operation, focus_mm=focus, least_mj_mm=least, most_mj_mm=most)


def _cell(reading: Reading) -> tuple[float, float]:
    try:
        energy, focus = (float(word) for word in reading.setting.split())
    except ValueError as error:
        words = "line energy in mJ/mm and focus offset in mm, such as 46.8 6, as setting"
        raise reading.wrong(reading.setting, words) from error
    return energy, focus
