"""How large the experiments are."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class StudySize:
    """Numbers of runs, maps and poses; the defaults are the paper's where it gives them."""

    seed: int = 1  # seed of the first run; run ``i`` has the i-th seed after it
    seeds: int = 5  # runs per setting, of which the best is kept [paper: 5]
    repeats: int = 10  # runs of `convergence` and `search` [paper: 10]
    ablation_seeds: int = 3  # runs per setting of `ablation`
    # population, generations: size of a search on coverage; 100 is the size of the paper's swarm in
    # MATLAB
    population: int = 100
    generations: int = 40
    # wide_population, wide_generations: the same for `reach` and `anchor`
    wide_population: int = 60
    wide_generations: int = 25
    # making_population, making_generations: the same for `price`
    making_population: int = 20
    making_generations: int = 15
    training_maps: int = 24  # maps that a design is trained on
    maps_at_once: int = 6  # how many of them, drawn anew, every generation meets
    # unseen_maps, poses: unseen maps, and poses on each [paper: 25 and 3]
    unseen_maps: int = 25
    poses: int = 3
    reach_maps: int = 25  # unseen maps of `reach`, one start on each
    headings: int = 50  # redeployments of a plain vine [paper: 50]


PAPER = StudySize()

QUICK = StudySize(
    seeds=2,
    repeats=2,
    ablation_seeds=2,
    population=6,
    generations=2,
    wide_population=4,
    wide_generations=2,
    making_population=4,
    making_generations=1,
    training_maps=3,
    maps_at_once=2,
    unseen_maps=3,
    poses=2,
    reach_maps=2,
    headings=6,
)
"""A smoke run: everything is done, nothing is learned from it."""
