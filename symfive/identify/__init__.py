"""Identification: parameters with uncertainties, what cannot be separated, outliers, noise."""

from symfive.identify._identify import identify, summarise
from symfive.identify._mounted import may_have_stayed
from symfive.identify._predict import Prediction, fitted_model, predict
from symfive.identify._redundancy import all_location_errors, redundancies
from symfive.identify._result import UNCONVERGED, Identification, MotionCurve
from symfive.identify._sequential import Stage, identify_by_position, identify_sequentially
from symfive.identify._tension import Tension, relief_notes, tension_notes, tensions
from symfive.identify._wiring import wiring_doubts
from symfive.inference import Confounding, Information, Noise, Outlier, Problem, confounded_combinations, data_rank

__all__ = [
    "UNCONVERGED", "Confounding", "Identification", "Information", "MotionCurve", "Noise", "Outlier", "Prediction", "Problem",
    "Stage", "Tension", "all_location_errors", "confounded_combinations", "data_rank", "fitted_model", "identify",
    "identify_by_position", "identify_sequentially", "may_have_stayed", "predict", "redundancies", "relief_notes", "summarise",
    "tension_notes", "tensions", "wiring_doubts",
]  # fmt: skip
