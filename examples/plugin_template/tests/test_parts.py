"""The parts keep vinefab's contracts: `pytest` runs this."""

from vinefab_mylab.farthest import Farthest
from vinefab_mylab.film_in_stock import film_in_stock
from vinefab_mylab.hillclimb import HillClimbConfig
from vinefab_mylab.posts import POSTS

from vinefab import testing


def test_the_task() -> None:
    testing.check_task(Farthest())


def test_the_environment() -> None:
    testing.check_environment(POSTS)


def test_the_optimizer() -> None:
    testing.check_optimizer(HillClimbConfig())


def test_the_rule() -> None:
    testing.check_rule(film_in_stock)
