"""Test rigs of maps, printed or laser-cut: solids, files, pictures and page.

Others use ``make`` (`make_rig`, `RigRequest`, `RigFiles`), ``part`` (`Rig`, `RigPart`,
`RigOptions`, `read_printer`), ``build`` (`build_rig`) and ``part_files`` (`read_rig`). A file
format for printed parts is a `part_files.PartFormat` and one line in `part_files.PART_FORMATS`.

Public function (``import vinefab as vf``): ``vf.rig(world, printer, out=...)``, see
`vinefab.app.making`.
"""

from vinefab.core.front_door import callable_room

callable_room(__name__)
