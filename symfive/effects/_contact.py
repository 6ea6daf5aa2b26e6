"""Effects by a contact between two flanks, whose state a recording does not show before its axis first moves."""

from __future__ import annotations

from dataclasses import dataclass

from symfive.effects._base import Effect, Parameter, Run
from symfive.motion import unmoved


@dataclass(frozen=True, kw_only=True)
class Contact(Effect):
    """An effect whose size depends on the flank that is in contact."""

    @property
    def started(self) -> str:
        """What a run calls the state in which its recording begins."""
        return f"setup.{self.key}.start"

    def start_of_contact(self, run: Run, axis: str, *, memory: bool = True) -> tuple[Parameter, ...]:
        """Position of a contact between its flanks (-1…+1) until its axis first moves in a run, or throughout it; uniform prior.

        In a static run whose second pose is reached by moving the axis the first one counts as approached like the second
        (docs/conventions.md, section 5); so does the first row of what goes by the direction alone and has no `memory`.
        """
        known = 0 if run.dynamic and memory else 1
        if unmoved(run.commands[axis]) <= known:
            return ()
        name = run.full_name(self.started)
        sigma = 3.0**-0.5  # of what is equally probable in -1…+1
        return (
            Parameter(name=name, unit="1", sigma=sigma, lower=-1.0, upper=1.0, kind="setup", run=run.id,
                      called=self.called),
        )  # fmt: skip
