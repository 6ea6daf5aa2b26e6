"""The one symbolic model: predicted readings and exact sensitivities by parameter name."""

from symfive.model._assembly import RowFunction, apply_errors, assemble, machine_parameters
from symfive.model._file import FittedModel, effect_to_data, effects_from_data, read_json, read_model, write_model
from symfive.model._model import Linearisation, Model
from symfive.model._signature import signature

__all__ = [
    "FittedModel", "Linearisation", "Model", "RowFunction", "apply_errors", "assemble", "effect_to_data",
    "effects_from_data", "machine_parameters", "read_json", "read_model", "signature", "write_model",
]  # fmt: skip
