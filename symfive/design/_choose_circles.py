"""The most informative set of circles, of those whose programs have a clear path."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from symfive.campaign import Run
from symfive.design._circles import Circle, Goal
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.moves import cleared
from symfive.nc import addressed

__all__ = ["check_clear", "chosen_clear"]


def check_clear(machine: Machine, runs: Iterable[Run]) -> None:
    """Raises `InputError` where something meets along the programs of these runs; a machine whose axes have no NC address gets
    none."""
    if addressed(machine):
        cleared(machine, runs, {})


def chosen_clear(
    machine: Machine, goal: Goal, circles: Sequence[Circle], count: int
) -> tuple[list[Circle], list[Circle]]:
    """The most informative `count` circles, and those that are left to choose from: one along which bodies meet gives way
    to another. Raises `InputError` where none is left."""
    left, clear = list(circles), set[int]()
    while True:
        chosen = _chosen(goal, left, count)
        for circle in chosen:
            if id(circle) in clear:
                continue
            try:
                check_clear(machine, circle.runs)
            except InputError as error:
                left = [other for other in left if other is not circle]
                if not left:
                    raise InputError(f"no circle can be run: {error.problem}", remedy=error.remedy) from None
                break
            clear.add(id(circle))
        else:
            return chosen, left


def _chosen(goal: Goal, circles: Sequence[Circle], count: int) -> list[Circle]:
    """Greedy, then exchange until nothing improves."""
    chosen: list[Circle] = []
    while len(chosen) < count:
        chosen.append(min(circles, key=lambda c: goal.value([*chosen, c])))
    value, improved = goal.value(chosen), True
    while improved:
        improved = False
        for place in range(count):
            others = chosen[:place] + chosen[place + 1 :]
            best = min(circles, key=lambda c: goal.value([*others, c]))
            if goal.value([*others, best]) < value - 1e-9:
                chosen[place], value, improved = best, goal.value([*others, best]), True
    return chosen
