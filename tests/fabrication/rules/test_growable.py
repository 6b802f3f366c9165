from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vinefab.core.rng import child
from vinefab.fabrication.rules.penalty import window_penalty
from vinefab.fabrication.rules.run_rules import run_checks
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.design import Build, Design, Level, default_fillets_mm
from vinefab.model.finding import Severity
from vinefab.model.laser import LaserProfile


def random_design(rng: np.random.Generator) -> Design:
    depth = int(rng.integers(1, 6))
    widths = tuple((60.0 * rng.uniform(0.4, 0.8, depth).cumprod()).tolist())
    levels = tuple(
        Level(
            branches=int(rng.integers(1, 4)),
            length_mm=float(rng.uniform(60, 900)),
            fan_rad=float(rng.uniform(0.2, 3.0)),
        )
        for _ in range(depth - 1)
    )
    build = Build(widths_mm=widths, fillet_mm=default_fillets_mm(widths))
    return Design(name="random", trunk_length_mm=300.0, levels=levels, build=build)


def test_the_penalty_is_zero_just_where_the_rule_finds_no_error(profile: LaserProfile) -> None:
    shut = 0
    for number in range(80):
        design = random_design(child(5, number))
        # The rule looks at no laser paths, so none are laid out.
        subject = replace(Subject.of(design), profile=profile)
        report = run_checks(subject, only=("VF-P03",))
        broken = any(f.severity is Severity.ERROR for f in report.findings)
        assert (window_penalty(design, profile) > 0.0) == broken
        shut += broken
    assert 10 < shut < 70


def test_the_penalty_falls_as_leaves_widen_and_follows_changed_limits(
    profile: LaserProfile, make: Callable[..., Design]
) -> None:
    values = [
        window_penalty(make((2, 300.0, 90.0), widths_mm=(60.0, width)), profile)
        for width in np.linspace(3.0, 40.0, 30)
    ]
    assert values[0] > 0.5
    assert values[-1] == 0.0
    assert (np.diff(values) <= 0.0).all()
    open_one = make((2, 300.0, 90.0), widths_mm=(60.0, 40.0))
    assert window_penalty(open_one, profile, {"VF-P03": {"loose_kpa": 20.0}}) > 0.0
