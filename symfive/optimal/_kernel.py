"""The compiled rows of a design: scaled sensitivities of one pose and their derivatives in what is decided.

A row's information is F(z) = J(z)ᵀ J(z), with J the readings' derivatives, each parameter scaled by its prior 1σ and each
reading by its noise. Only these small kernels are differentiated; criteria are put together from them in numpy.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca

from symfive.arrays import Array
from symfive.compiled import Mapped


class Kernel:
    """Rows of one kind.

    `z` what is decided for one row (nz), `k` constants of its set-up (nk), `rows` J (ny × width) and `limits` (ng) what
    must be ≥ 0, all CasADi SX; a derivative is made when it is first asked for. Arrays keep the order that CasADi writes: J as
    (n, width, ny), slopes as (n, nz, width, ny).
    """

    def __init__(self, z: Any, k: Any, rows: Any, limits: Any) -> None:
        self.size, self.constants = z.numel(), k.numel()
        self.readings, self.width = rows.shape
        self.limit_count = limits.numel()
        self._z, self._k, self._flat, self._bound = z, k, ca.densify(ca.vec(rows)), ca.densify(limits)
        self._matrix = rows

    def of_first(self, count: int) -> Kernel:
        """The same with only the first `count` of `z` decided; the others come before `k`."""
        return Kernel(self._z[:count], ca.vertcat(self._z[count:], self._k), self._matrix, self._bound)

    def limited_to(self, which: Sequence[int]) -> Kernel:
        """The same with some of the limits, by their numbers."""
        return Kernel(self._z, self._k, self._matrix, self._bound[list(which)])

    def _mapped(self, name: str, result: Sequence[Any], *more: Any) -> Mapped:
        return Mapped(
            ca.Function(name, [self._z, self._k, *more], [ca.densify(part) for part in result], {"cse": True})
        )

    @cached_property
    def _rows(self) -> Mapped:
        return self._mapped("rows", [self._flat])

    @cached_property
    def _slopes(self) -> Mapped:
        return self._mapped("slopes", [self._flat, ca.jacobian(self._flat, self._z)])

    @cached_property
    def _bent(self) -> Mapped:
        return self._mapped("bent", *self._hessian(self._flat))

    @cached_property
    def _limits(self) -> Mapped:
        return self._mapped("limits", [self._bound])

    @cached_property
    def _bounded(self) -> Mapped:
        return self._mapped("bounded", [ca.jacobian(self._bound, self._z)])

    @cached_property
    def _curved(self) -> Mapped:
        return self._mapped("curved", *self._hessian(self._bound))

    def _hessian(self, vector: Any) -> tuple[list[Any], Any]:
        """Of ⟨weights, vector⟩, and the weights."""
        weights = ca.SX.sym("weights", vector.numel())
        return [ca.hessian(ca.dot(weights, vector), self._z)[0]], weights

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
