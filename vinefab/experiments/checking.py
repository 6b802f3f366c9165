"""Whether the shipped recipe can make a design."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vinefab import __version__
from vinefab.core.hashing import fingerprint
from vinefab.experiments.designs import design_from
from vinefab.files.profile import read_profile
from vinefab.files.shipped import DEFAULT_RECIPE
from vinefab.optimize.settings import plain_settings
from vinefab.pipeline.making import Making


@dataclass(frozen=True, slots=True, kw_only=True)
class Checking:
    """The whole check of a design, as `vinefab check` makes it, without a map.

    Parameters
    ----------
    design
        As `plain_design` gives it.
    """

    design: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Fingerprint of everything that it depends on."""
        return f"check_{fingerprint(plain_settings(self), __version__)}"

    def run(self) -> dict[str, Any]:
        """Return ``passes``; what breaks the cheap rules is not looked at further."""
        design, making = design_from(self.design), Making(profile=read_profile(DEFAULT_RECIPE))
        return {"passes": making(design) == 0.0 and making.passes(design)}
