"""What the evolutionary algorithms take of pymoo, which takes a second to import."""

from pymoo.core.duplicate import DefaultDuplicateElimination
from pymoo.core.mixed import MixedVariableMating
from pymoo.core.population import Population
from pymoo.core.problem import Problem
from pymoo.core.variable import Integer, Real
from pymoo.operators.crossover.sbx import SBX
from pymoo.operators.mutation.pm import PM
from pymoo.operators.repair.rounding import RoundingRepair
from pymoo.operators.selection.tournament import TournamentSelection
from pymoo.operators.survival.rank_and_crowding.metrics import calc_crowding_distance
from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

__all__ = [
    "PM",
    "SBX",
    "DefaultDuplicateElimination",
    "Integer",
    "MixedVariableMating",
    "NonDominatedSorting",
    "Population",
    "Problem",
    "Real",
    "RoundingRepair",
    "TournamentSelection",
    "calc_crowding_distance",
]
