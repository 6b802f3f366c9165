"""The fabrication package: laser files, instructions, bill of materials, pictures, manifest.

Others use ``prepare`` (`prepare`, `package`, `zip_bytes` and report sections), ``bom`` (with
`machine_time`), ``sheet_pictures`` (`job_plan`, `findings_plan`, `job_animation`),
``package_texts`` (README.txt, ``job.json``) and, of robots in pieces, ``piece_joining``
(`joining_order`) and ``assembly_drawing`` (`exploded_picture`).
"""
