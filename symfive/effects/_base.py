"""The contract of an effect: a piece of physics that joins the model, from one small file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from symfive.parameters import Parameter

if TYPE_CHECKING:
    from symfive.campaign import Campaign, Run
    from symfive.model._row import Row
    from symfive.motion import Signal

__all__ = ["STAGES", "Effect"]

STAGES = ("drive", "axis", "structure", "reading")
"""In which order effects enter a row: inside the position loop, behind the drive, in the structure, in the instrument."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Base of all effects. A subclass is one file and one line in the table of `symfive.effects`.

    `id` is its name in the vocabulary (docs/conventions.md, section 7), `stage` one of `STAGES`, `axis` the axis
    it belongs to (None: no axis). Further fields of a subclass say which of several forms is meant (a component, a run).
    """

    id: ClassVar[str]
    stage: ClassVar[str] = "structure"
    says: ClassVar[str] = ""
    axis: str | None = None

    @property
    def key(self) -> str:
        """Prefix of its parameters' names, as `backlash.C`."""
        return self.id if self.axis is None else f"{self.id}.{self.axis}"

    def parameters(self, campaign: Campaign) -> tuple[Parameter, ...]:
        """Its parameters with priors; names begin with `key`."""
        return ()

    def signals(self) -> tuple[Signal, ...]:
        """Signals along the run that it needs beside the axis positions."""
        return ()

    def frees(self) -> Mapping[tuple[str, str], str]:
        """Drive quantities that become parameters: (axis, quantity) → parameter name. `("", "delay")` is the clock's delay."""
        return {}

    def applies(self, run: Run) -> bool:
        """Whether it can act in this run."""
        return True

    def apply(self, row: Row) -> None:
        """Change the row's symbols (the exact forward model)."""

    def parameter(self, row: Row, name: str) -> Any:
        """Its own parameter `name` in internal units."""
        return row.parameter(f"{self.key}.{name}")

    def own(self, name: str, unit: str, sigma: float, **more: Any) -> Parameter:
        """A parameter of this effect."""
        return Parameter(name=f"{self.key}.{name}", unit=unit, sigma=sigma, kind="effect", **more)
