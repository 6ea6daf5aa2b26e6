"""The self-test in C: expected values from the model's chain and automatic differentiation, round trips, finite differences."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from symfive.arrays import Array
from symfive.codegen._sources import Sources, filled
from symfive.codegen._subject import Subject
from symfive.compiled.scalar import number

GOLDEN, COUNT = 0.6180339887498949, 8


@dataclass(frozen=True)
class Vectors:
    """`q` (N, axes) mm and rad, one `tool` (3) and `p` for all; the expected results per vector."""

    q: Array
    tool: Array
    p: Array
    position: Array
    direction: Array
    by_q: Array
    by_p: Array


def spread_vectors(subject: Subject) -> Vectors:
    """Positions spread over the travels (rotary axes over one turn at most), parameters of the size of their priors."""
    spread = np.modf(np.outer(np.arange(1, COUNT + 1), GOLDEN ** np.arange(1, len(subject.axes) + 1)))[0]
    spread = np.modf(spread * 7.0 + 0.5)[0]
    q = np.empty((COUNT, len(subject.axes)))
    for i, name in enumerate(subject.axes):
        axis = subject.machine.axes[name]
        low, high = (v * axis.to_internal for v in axis.travel)
        if axis.rotary:
            low, high = max(low, -np.pi), min(high, np.pi)
        q[:, i] = np.round(low + (high - low) * spread[:, i], 6)
    tool = np.array([1.5, -2.5, -120.0])
    waves = np.cos(1.0 + np.arange(len(subject.parameters)))
    sizes = np.array([parameter.sigma if np.isfinite(parameter.sigma) else 1.0 for parameter in subject.parameters])
    p = np.round(np.asarray(subject.values) + waves * sizes, 6)
    reference = subject.function()
    results = [[np.asarray(part, dtype=float) for part in reference(row, tool, p)] for row in q]
    stacked = [np.array([row[k].ravel(order="F") for row in results]) for k in range(4)]
    return Vectors(q, tool, p, *stacked)


def selftest(sources: Sources) -> str:
    """The text of `…_selftest.c`."""
    vectors = spread_vectors(sources.subject)
    names, prefix, macro = sources.names, sources.prefix, sources.prefix.upper()
    pieces = {"check_inverse": "", "call_inverse": "", "vector_by_p": "", "check_by_p": ""}
    if sources.solved:
        scatter = "".join(f"    again[{i}] += ({prefix}_real)1.0;\n" for i in sources.solved)
        pieces["check_inverse"] += filled("selftest_inverse.c", scatter=scatter, **names)
        pieces["call_inverse"] += "        check_inverse(number);\n"
    if sources.turning:
        first, second = (sources.subject.axes.index(name) for name in sources.turning)
        pieces["check_inverse"] += filled("selftest_direction.c", first_place=first, second_place=second, **names)
        pieces["call_inverse"] += "        check_direction(number);\n"
    if sources.parameters:
        pieces["vector_by_p"] = (
            f"static const double vector_by_p[VECTORS][3 * {macro}_PARAMETERS] = {{\n{_rows(vectors.by_p)}\n}};"
        )
        pieces["check_by_p"] = filled("selftest_parameters.c", **names)
    return filled(
        "selftest.c", vectors=len(vectors.q), vector_q=_rows(vectors.q), vector_tool=_flat(vectors.tool),
        vector_p=_flat(vectors.p if sources.parameters else [0.0]), vector_position=_rows(vectors.position),
        vector_direction=_rows(vectors.direction), vector_by_q=_rows(vectors.by_q), **pieces, **names,
    )  # fmt: skip


def _flat(values: Iterable[float]) -> str:
    text = ", ".join(number(float(v)) for v in values)
    return textwrap.fill(text, 112, subsequent_indent="    ", break_on_hyphens=False)


def _rows(table: Iterable[Iterable[float]]) -> str:
    rows = []
    for row in table:
        text = ", ".join(number(float(v)) for v in row)
        rows.append(textwrap.fill(f"{{ {text} }}", 112, initial_indent="    ", subsequent_indent="      ",
                                  break_on_hyphens=False))  # fmt: skip
    return ",\n".join(rows)
