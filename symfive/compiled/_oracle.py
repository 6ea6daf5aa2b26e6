"""A function that Python computes, as CasADi's solvers call it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import casadi as ca
import numpy as np


class Oracle(ca.Callback):
    """Inputs and outputs by name with their sparsities; `compute` makes the outputs' nonzeros (column by column) of the inputs';
    `jacobian`, where one is needed, has the inputs and, behind them, the outputs as inputs."""

    def __init__(
        self, name: str, inputs: Mapping[str, Any], outputs: Mapping[str, Any], compute: Callable[..., Iterable[Any]],
        jacobian: Oracle | None = None,
    ) -> None:  # fmt: skip
        ca.Callback.__init__(self)
        self._inputs, self._outputs, self._compute, self._jacobian = dict(inputs), dict(outputs), compute, jacobian
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_name_in(self, i: int) -> str:
        return list(self._inputs)[i]

    def get_name_out(self, i: int) -> str:
        return list(self._outputs)[i]

    def get_sparsity_in(self, i: int) -> Any:
        return list(self._inputs.values())[i]

    def get_sparsity_out(self, i: int) -> Any:
        return list(self._outputs.values())[i]

    def has_jacobian(self) -> bool:
        return self._jacobian is not None

    def get_jacobian(self, name: str, inputs: Any, outputs: Any, options: Any) -> Any:
        return self._jacobian

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arguments: Any, results: Any) -> int:
        given = [np.frombuffer(a, dtype=float) if a is not None else np.zeros(0) for a in arguments]
        for result, values in zip(results, self._compute(*given), strict=True):
            if result is not None:
                np.frombuffer(result, dtype=float)[:] = values
        return 0
