from dataclasses import replace

import numpy as np

from vinefab.fabrication.package.sheet_pictures import job_plan
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.outline import Contour


def test_a_robot_in_tiles_lies_on_film_and_not_on_a_bed():
    line = Contour.polyline(np.array([[5.0, 5.0], [395.0, 5.0]]), closed=False)
    path = LaserPath(operation=Operation.WELDCUT, contour=line)
    job = Job(name="long", sheet_width_mm=400.0, sheet_height_mm=10.0, paths=(path,))
    assert "bed 400 x 10 mm" in job_plan(job).axes[0].get_title()
    title = job_plan(replace(job, tiles=(job, job))).axes[0].get_title()
    assert "film, in tiles, 400 x 10 mm" in title
    assert "bed" not in title
