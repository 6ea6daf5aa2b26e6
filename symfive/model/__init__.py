"""The one symbolic model: predicted readings and exact sensitivities by parameter name."""

from symfive.model._model import Linearisation, Model

__all__ = ["Linearisation", "Model"]
