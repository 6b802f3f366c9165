"""Test rigs of maps, printed or laser-cut: solids, files, pictures and page.

Others use ``make`` (`make_rig`, `RigRequest`, `RigFiles`), ``options`` (`RigOptions`,
`read_printer`), ``plate`` (`build_rig`), ``part`` (`Rig`, `RigPart`) and ``rig_json``
(`read_rig`). A file format for printed parts is one module with a `part.PartFormat` and one line
in `part_files.PART_FORMATS`.
"""
