"""The compiled rows of a design: scaled sensitivities of one pose and their derivatives in what is decided.

A row's information is F(z) = J(z)ᵀ J(z), with J the readings' derivatives, each parameter scaled by its prior 1σ and each
reading by its noise. Only these small kernels are differentiated; criteria are put together from them in numpy.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from symfive.compiled import Mapped

__all__ = ["Kernel"]

Array = NDArray[np.float64]


class Kernel:
    """Rows of one kind.

    `z` what is decided for one row (nz), `k` constants of its set-up (nk), `rows` J (ny × width) and `limits` (ng) what
    must be ≥ 0, all CasADi SX. Arrays keep the order that CasADi writes: J as (n, width, ny), slopes as (n, nz, width, ny).
    """

    def __init__(self, z: Any, k: Any, rows: Any, limits: Any) -> None:
        self.size, self.constants = z.numel(), k.numel()
        self.readings, self.width = rows.shape
        self.limit_count = limits.numel()
        flat = ca.densify(ca.vec(rows))
        weights = ca.SX.sym("weights", flat.numel())
        options = {"cse": True}
        slope = ca.densify(ca.jacobian(flat, z))
        bent = ca.densify(ca.hessian(ca.dot(weights, flat), z)[0])
        limits = ca.densify(limits)
        self._rows = Mapped(ca.Function("rows", [z, k], [flat], options))
        self._slopes = Mapped(ca.Function("slopes", [z, k], [flat, slope], options))
        self._bent = Mapped(ca.Function("bent", [z, k, weights], [bent], options))
        self._limits = Mapped(ca.Function("limits", [z, k], [limits], options))
        bounded = ca.densify(ca.jacobian(limits, z)) if self.limit_count else ca.DM(0, 1)
        self._bounded = Mapped(ca.Function("bounded", [z, k], [bounded], options))
        multipliers = ca.SX.sym("multipliers", self.limit_count)
        curved = ca.densify(ca.hessian(ca.dot(multipliers, limits), z)[0]) if self.limit_count else ca.DM(0, 1)
        self._curved = Mapped(ca.Function("curved", [z, k, multipliers], [curved], options))

    def rows(self, z: Array, k: Array) -> Array:
        """Scaled sensitivities (n, width, ny)."""
        return self._rows(z, k)[0].reshape(len(z), self.width, self.readings)

    def slopes(self, z: Array, k: Array) -> tuple[Array, Array]:
        """Sensitivities (n, width, ny) and their derivatives in z (n, nz, width, ny)."""
        rows, slopes = self._slopes(z, k)
        shape = (self.width, self.readings)
        return rows.reshape(len(z), *shape), slopes.reshape(len(z), self.size, *shape)

    def curvature(self, z: Array, k: Array, weights: Array) -> Array:
        """Second derivatives (n, nz, nz) of ⟨weights, J⟩; `weights` (n, width, ny)."""
        return self._bent(z, k, weights.reshape(len(z), -1))[0].reshape(len(z), self.size, self.size)

    def limits(self, z: Array, k: Array) -> Array:
        """What must be ≥ 0: (n, ng)."""
        return self._limits(z, k)[0]

    def limit_slopes(self, z: Array, k: Array) -> Array:
        """Their derivatives (n, nz, ng)."""
        return self._bounded(z, k)[0].reshape(len(z), self.size, self.limit_count)

    def limit_curvature(self, z: Array, k: Array, multipliers: Array) -> Array:
        """Second derivatives (n, nz, nz) of ⟨multipliers, limits⟩."""
        return self._curved(z, k, multipliers)[0].reshape(len(z), self.size, self.size)
