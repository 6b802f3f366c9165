"""What a flat pattern becomes under pressure: a simulation of welded sheets, without contact.

Other rooms use `joint` (one joint: deployed angles, lengths, loads) and `robot` (a whole pattern).
Both stand on `sheet` (an outline as triangles), `mesh`, `membrane` (energy and derivatives) and
`solve` (its minimum). Everything is simulated; nothing has been measured on film.
"""
