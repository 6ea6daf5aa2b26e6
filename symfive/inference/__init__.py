"""Inference on the linearised model: noise, whitened information, outliers, the maximum, what cannot be separated."""

from symfive.inference._information import Confounding, Information, confounded_combinations, data_rank, not_separated
from symfive.inference._noise import Block, square_of
from symfive.inference._outliers import Outlier
from symfive.inference._problem import Problem
from symfive.inference._solve import gauss_newton, halved, solve
from symfive.inference._whitening import Noise, Whitening, whiten
from symfive.inference._windows import windows_of

__all__ = [
    "Block", "Confounding", "Information", "Noise", "Outlier", "Problem", "Whitening", "confounded_combinations", "data_rank",
    "gauss_newton", "halved", "not_separated", "solve", "square_of", "whiten",
    "windows_of",
]  # fmt: skip
