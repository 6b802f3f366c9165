"""Laser formats: one file each, with writer, reader, tolerance and registration.

Others use ``laser_formats`` (`LASER_FORMATS`, `laser_files`, `ensure_read_back`),
``laser_drawing`` (layers, colour presets, `LaserFormat`, `LaserFileSpec`, `file_problems`) and the
formats themselves (``dxf_format.DXF``, ``svg_format.SVG``, ``lightburn_format.LIGHTBURN``).
"""
