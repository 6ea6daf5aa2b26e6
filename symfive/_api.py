"""Everything that `import symfive` offers by name; loaded when the first of these names is used."""

from symfive.campaign import Campaign, Run, SetupSigma, read_campaign, write_campaign
from symfive.check import check
from symfive.codegen import codegen
from symfive.convert import convert
from symfive.design import assess, plan
from symfive.diagnose import diagnose
from symfive.effects import make_effect
from symfive.errors import InputError
from symfive.history import History
from symfive.identify import fitted_model, identify, identify_by_position, identify_sequentially, predict, redundancies
from symfive.machine import Machine, preset, presets, read_machine, write_machine
from symfive.model import Model, read_model, write_model
from symfive.simulate import simulate

__all__ = [
    "Campaign", "History", "InputError", "Machine", "Model", "Run", "SetupSigma", "assess", "check", "codegen", "convert",
    "diagnose", "fitted_model", "identify", "identify_by_position", "identify_sequentially", "make_effect", "plan", "predict",
    "preset", "presets", "read_campaign", "read_machine", "read_model", "redundancies", "simulate", "write_campaign",
    "write_machine", "write_model",
]  # fmt: skip
