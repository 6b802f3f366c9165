"""From outlines to what the laser does on a sheet: paths, marks, placement, tiles.

Other rooms use `laser_job.laser_job` (the job of a sheet), `placement.SheetOptions` (what the sheet
holds), `passes.closes` and `passes.frees` (properties of a path) and `marks.lettered` (text as
strokes).
"""
