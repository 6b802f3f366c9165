"""What a flat pattern becomes under pressure: a simulation of welded sheets, without contact.

Other rooms use `joint` (one joint: deployed angles, lengths, loads), `robot` (a whole pattern) and
`pattern` (what is cut for a design). They stand on `mesh` (an outline as triangles) and `membrane`
(energy, derivatives, its minimum). Everything is simulated; nothing has been measured on film.
"""
