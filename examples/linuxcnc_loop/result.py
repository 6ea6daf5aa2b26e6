"""What a closed loop leaves: the campaigns before and after, their deviations, and the identification between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from symfive.campaign import Campaign
from symfive.identify import Identification
from symfive.machine import Machine

from .deviation import Deviation, Rest, size
from .truth import TrueMachine


@dataclass(frozen=True, kw_only=True)
class Passage:
    """Programmes run through the control once.

    `campaign` with the readings; `measured` deviations that these show, the set-up taken out; `true` the true ones, the work
    offset of each set-up set anew; `whole` nothing taken out; `geometry` the set-up taken out; `rest` the parts of `true`.
    """

    campaign: Campaign
    measured: Deviation
    true: Deviation
    whole: Deviation
    geometry: Deviation
    rest: Rest

    def to_data(self) -> dict[str, Any]:
        """The figures, µm."""
        kinds = {
            "true": self.true, "true_nothing_taken_out": self.whole, "true_set_up_taken_out": self.geometry,
            "measured": self.measured,
        }  # fmt: skip
        return {
            "poses": len(self.true.distances),
            **{f"{name}_um": {"rms": _short(d.rms), "max": _short(d.largest), "per_coordinate": _short(d.per_coordinate)}
               for name, d in kinds.items()},
            "parts_rms_um": {
                "control": _short(size(self.rest.control)), "identified_values": _short(size(self.rest.values)),
                "beyond_the_model": _short(size(self.rest.beyond)),
            },
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A closed loop on one machine: the plan's poses and the held-out ones, every passage with its own set-up and noise.
    `control` says which control ran it."""

    preset: str
    control: str
    machine: Machine
    truth: TrueMachine
    identification: Identification
    noise_um: float
    before: Passage
    after: Passage
    held_out_before: Passage
    held_out_after: Passage
    seconds: float

    @property
    def factor(self) -> float:
        """How many times the true rms deviation at the plan's poses became smaller."""
        return self.before.true.rms / self.after.true.rms

    @property
    def held_out_factor(self) -> float:
        """The same at poses that the plan did not visit."""
        return self.held_out_before.true.rms / self.held_out_after.true.rms

    def errors_in_sigmas(self) -> dict[str, float]:
        """(identified minus true) / 1σ of every location error."""
        found = self.identification
        return {n: (found[n] - true) / found.uncertainty(n) for n, true in self.truth.location_errors.items()}

    def to_data(self) -> dict[str, Any]:
        """results.json of this machine."""
        sigmas = np.array(list(self.errors_in_sigmas().values()))
        found = self.identification
        return {
            "preset": self.preset, "control": self.control, "structure": self.machine.structure.code, "noise_um": self.noise_um,
            "before": self.before.to_data(), "after": self.after.to_data(),
            "held_out_before": self.held_out_before.to_data(), "held_out_after": self.held_out_after.to_data(),
            "factor": _short(self.factor), "held_out_factor": _short(self.held_out_factor),
            "chi2_dof": _short(found.chi2_dof), "drift_um": [effect["amplitude"] for effect in self.truth.effects],
            "location_errors": {
                name: {
                    "true": _short(true), "identified": _short(found[name]), "std": _short(found.uncertainty(name)),
                    "sigmas": _short(self.errors_in_sigmas()[name]),
                }
                for name, true in self.truth.location_errors.items()
            },
            "location_errors_in_sigmas": {
                "rms": _short(float(np.sqrt(np.mean(sigmas**2)))), "largest": _short(float(np.abs(sigmas).max())),
            },
            "seconds": round(self.seconds),
        }  # fmt: skip


def _short(value: float) -> float:
    return float(f"{value:.4g}")
