"""symfive: one symbolic model of five-axis machine tools, for identification, test design, diagnosis and code.

    import symfive as sf

    campaign = sf.read_campaign("measured/")
    result = sf.identify(campaign)          # errors with uncertainties, and those that cannot be separated
    verdict = sf.diagnose(campaign)         # faults: cause, place, size, confidence
    plan = sf.plan(sf.preset("table-bc"))   # the most informative measurement

Data flow one way: machine and campaign (plain data) → model (CasADi) → identify, plan, diagnose → report.
"""

# ruff: noqa: F403, F405  (the names are properties of the package)
from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from symfive.version import __version__ as __version__

if TYPE_CHECKING:
    from symfive._api import *

__all__ = [
    "Campaign", "History", "InputError", "Machine", "Model", "Run", "SetupSigma", "assess", "check", "codegen", "convert",
    "diagnose", "fitted_model", "identify", "identify_by_position", "identify_sequentially", "make_effect", "plan", "predict",
    "preset", "presets", "read_campaign", "read_machine", "read_model", "redundancies", "simulate", "write_campaign",
    "write_machine", "write_model",
]  # fmt: skip


class _Package(ModuleType):
    """This package, its names loaded on first use: the command line says its version at once.

    A property, unlike a module's `__getattr__` (PEP 562), also wins over the package of the same name: `symfive.identify` is
    the function, whichever was imported first.
    """

    def __dir__(self) -> list[str]:
        return sorted({*__all__, "__doc__", "__version__"})


def _loaded(name: str) -> property:
    def value(package: ModuleType) -> Any:
        return getattr(import_module("symfive._api"), name)

    def keep(package: ModuleType, module: Any) -> None:
        """The import system sets a package's name in its parent; the function stays."""

    return property(value, keep)


for _name in __all__:
    setattr(_Package, _name, _loaded(_name))
sys.modules[__name__].__class__ = _Package
