"""Extras of the package: what each brings, and the one line that asks for one."""

from importlib.util import find_spec

from vinefab.core.errors import MissingPackageError

EXTRAS = {
    "cluster": ("distributed", "cryptography"),
    "evolution": ("pymoo",),
    "gis": ("pyogrio", "pyproj"),
    "studies": ("matplotlib",),
    "studio": ("starlette", "tomlkit", "uvicorn", "watchfiles", "websockets"),
    "tables": ("pandas",),
    "vision": ("cv2",),
}
"""By extra for users: the modules that it brings and vinefab imports."""


def ensure_extra(extra: str, needed_for: str) -> None:
    """Check, before anything is written, that the packages of an extra are installed.

    Raises
    ------
    MissingPackageError
        If one of them is not.
    """
    missing = [name for name in EXTRAS[extra] if find_spec(name) is None]
    if missing:
        raise MissingPackageError(" and ".join(missing), needed_for, extra)
