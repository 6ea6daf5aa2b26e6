"""Identification: parameters with uncertainties, what cannot be told apart, outliers, noise."""

from symfive.identify._confounding import Confounding, confounded_combinations, data_rank
from symfive.identify._identify import identify
from symfive.identify._noise import Noise
from symfive.identify._problem import Outlier, Problem
from symfive.identify._result import Identification, MotionCurve

__all__ = [
    "Confounding", "Identification", "MotionCurve", "Noise", "Outlier", "Problem", "confounded_combinations", "data_rank", "identify",
]  # fmt: skip
