"""FIGAROH's and pydex's choice of poses from a list of candidates, for `benchmarks/design.py --peers PYTHON`.

    PYTHON benchmarks/peers.py CANDIDATES.npz POINTS

Run by a Python that has them (`pip install figaroh pydex` in an environment of its own); symfive is not needed. The file
holds `z` (n, nz) and `rows` (n, p, ny), the sensitivities of each candidate's readings to the p parameters. Prints JSON:
name → chosen candidates and CPU seconds, or the reason why it was not run.
"""

from __future__ import annotations

import contextlib
import io
import json
import random
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

Array = np.ndarray


def figaroh(z: Array, rows: Array, points: int) -> list[int]:
    """FIGAROH's DETMAX on its dictionary of information matrices."""
    from figaroh.optimal.base_optimal_calibration import Detmax

    random.seed(0)
    search = Detmax({i: row @ row.T for i, row in enumerate(rows)}, points)
    chosen: list[int] = []
    judge = search.get_critD

    def watched(subset: list[int]) -> float:
        """Its final set is a local variable that it does not give back: the best set of the right size it ever looked at."""
        nonlocal chosen
        value = judge(subset)
        if len(subset) == points and value > watched.best:  # type: ignore[attr-defined]
            watched.best, chosen = value, list(subset)  # type: ignore[attr-defined]
        return value

    watched.best = -1.0  # type: ignore[attr-defined]
    search.get_critD = watched
    search.main_algo()
    return chosen


def pydex(z: Array, rows: Array, points: int) -> list[int]:
    """pydex's optimal efforts (CVXPY) and its apportionment of them to whole numbers."""
    from pydex.core.designer import Designer

    place = {tuple(row): i for i, row in enumerate(z)}
    designer = Designer()
    designer.simulate = lambda ti_controls, model_parameters: model_parameters @ rows[place[tuple(ti_controls)]]
    designer.model_parameters = np.ones(rows.shape[1])
    designer.ti_controls_candidates = z
    designer.initialize(verbose=0)
    designer.design_experiment(designer.d_opt_criterion, package="cvxpy", optimizer="CLARABEL")
    designer.apportion(points)
    numbers = np.nan_to_num(np.asarray(designer.apportionments, dtype=float)).astype(int).ravel()
    support = [int(candidate[0]) for candidate in designer.optimal_candidates]
    return [i for i, count in zip(support, numbers, strict=True) for _ in range(count)]


PEERS: dict[str, Callable[[Array, Array, int], list[int]]] = {"FIGAROH DETMAX": figaroh, "pydex": pydex}


def main(path: str, points: int) -> None:
    """Run each and print what it chose."""
    data = np.load(path)
    found: dict[str, Any] = {}
    for name, choose in PEERS.items():
        start = time.process_time()
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                chosen = choose(data["z"], data["rows"], points)
            found[name] = {"chosen": chosen, "seconds": time.process_time() - start}
        except Exception as error:  # whatever a peer's release trips over is reported, not hidden
            found[name] = {"reason": f"{type(error).__name__}: {error}".splitlines()[0][:200]}
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
