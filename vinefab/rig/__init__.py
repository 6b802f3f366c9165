"""Test rigs of maps, printed or laser-cut: solids, files, pictures and page.

Others use ``make`` (`make_rig`, `RigRequest`), ``page`` (`RigFiles`), ``rig_options``
(`RigOptions`, `read_printer`), ``build`` (`build_rig`), ``part`` (`Rig`, `RigPart`) and
``rig_json`` (`read_rig`). A file format for printed parts is a `part_files.PartFormat` and one
line in `part_files.PART_FORMATS`.

Public function (``import vinefab as vf``): ``vf.rig(world, printer, out=...)``, see
`vinefab.app.making`.
"""

import inspect
import sys
from types import ModuleType
from typing import Any

from vinefab.core.front_door import front_door


class _CallableRoom(ModuleType):
    """A room that is also the public function of its name.

    Python binds a package to its name in the package above once one of its modules is loaded, so
    ``vinefab.rig`` cannot be the function alone: it is both, whatever was loaded before.
    """

    def __call__(self, *given: Any, **named: Any) -> Any:  # noqa: ANN401  see `vinefab.app.making.rig`
        """Call `vinefab.app.making.rig`."""
        return front_door("app.making").rig(*given, **named)

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(front_door("app.making").rig)


sys.modules[__name__].__class__ = _CallableRoom
