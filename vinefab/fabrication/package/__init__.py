"""The fabrication package: laser files, instructions, bill of materials, pictures, manifest.

Others use ``prepare`` (`prepare`, `package`, `zip_bytes` and the report sections of a prepared
design), ``package_page`` (report sections), ``bom`` (with `machine_time`), ``job_json`` (numbers
with their standing), ``sheet_pictures`` (`job_plan`, `findings_plan`, `job_animation`) and, of
robots in pieces, ``piece_joining`` (`joining_order`) and ``assembly_drawing`` (`exploded_picture`).
"""
