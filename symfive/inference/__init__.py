"""Inference on the linearised model: noise, whitened information, outliers, the maximum, what cannot be told apart."""

from symfive.inference._confounding import Confounding, confounded_combinations, data_rank
from symfive.inference._noise import Block, Noise, whiten
from symfive.inference._problem import Information, Outlier, Problem
from symfive.inference._solve import gauss_newton, solve

__all__ = [
    "Block", "Confounding", "Information", "Noise", "Outlier", "Problem", "confounded_combinations", "data_rank",
    "gauss_newton", "solve", "whiten",
]  # fmt: skip
