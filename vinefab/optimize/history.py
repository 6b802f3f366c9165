"""What happened in a run, generation by generation."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vinefab.model.checked import Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Generation:
    """One generation: m points and what became of them.

    Parameters
    ----------
    number
        0 for the first.
    x
        Points in the unit cube, shape (m, d).
    fitness
        What the optimizer was told, shape (m,).
    composite
        Composite scores, shape (m,); NaN for a point that is no design.
    penalty
        Fabrication penalties, shape (m,); 0 everywhere in a run that does not ask for designs
        that can be made.
    terms
        Means of the task's terms over the evaluations, each of shape (m,).
    seconds
        How long it took.
    best
        The largest fitness.
    """

    number: int
    x: Floats
    fitness: Floats
    composite: Floats
    penalty: Floats
    terms: Mapping[str, Floats]
    seconds: float
    best: float = field(init=False)

    def __post_init__(self) -> None:
        # Looked at for every generation after every other one.
        object.__setattr__(self, "best", float(self.fitness.max()))

    @property
    def fabricable_share(self) -> float:
        """Share of the points that are designs without a penalty."""
        return float(((self.penalty == 0.0) & np.isfinite(self.composite)).mean())

    @property
    def has_designs(self) -> bool:
        """Whether any point is a design."""
        return bool(np.isfinite(self.composite).any())


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """What a user sees while a run goes on.

    Parameters
    ----------
    generation, generations
        How many are done, and how many there are at most.
    best
        Best fitness of the run so far.
    mean, spread
        Mean and standard deviation of the composite scores of this generation's designs.
    fabricable_share
        Share of this generation's designs that can be made.
    elapsed_s, left_s
        Time spent by all sessions together; time that the rest will take at this pace.
    """

    generation: int
    generations: int
    best: float
    mean: float
    spread: float
    fabricable_share: float
    elapsed_s: float
    left_s: float
