"""The C source of a CasADi function over rows: vectors of rows, what is held for all of them once, the function's own bits."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from importlib.resources import files
from string import Template
from typing import Any

from symfive.compiled.graph import exact_graph
from symfive.compiled.vector import HELPERS, LANES, Rows, indented, plain_lines


@dataclass(frozen=True)
class Source:
    """A C text that holds numbers and names of its own only, and the operations a row."""

    text: str
    operations: int


def source_of(function: Any, held: Collection[int]) -> Source:
    """The source of a function of scalars (SX) with dense results; inputs of the indices `held` are the same for all rows.

    Raises `NotImplementedError` for an operation that is not written in C here.
    """
    inputs = [f"x{i}_" for i in range(function.n_in())]
    outputs = [f"y{i}_" for i in range(function.n_out())]
    graph = exact_graph(function, inputs, outputs)
    moving = tuple(name for i, name in enumerate(inputs) if i not in held)
    nodes = [node for name in outputs for node in graph.outputs[name]]
    rows = Rows(graph, moving, [(f"y[{place}] = %s;", node) for place, node in enumerate(nodes)])
    fixed = [target for target in rows.targets if not rows.moves[target[1]]]
    prepare = rows.prepare()
    load, gather, first = [], [], 0
    for i, name in enumerate(inputs):
        load.append(f"const double *const {name} = given[{i}];")
        if i not in held:
            gather.append(f"gather({name}, {function.nnz_in(i)}U, row, used, x + {first}U);")
            first += function.nnz_in(i)
    scatter, place = [], 0
    for i, name in enumerate(outputs):
        size = len(graph.outputs[name])
        scatter.append(f"scatter(y + {place}U, {size}U, results[{i}] + (row * {size}U), used);")
        place += size
    offsets, first = [], 0
    for i, name in enumerate(inputs):
        if i not in held:
            offsets.append(f"const v *const {name} = x + {first}U;")
            first += function.nnz_in(i)
    text = (files("symfive.compiled") / "templates" / "rows.c").read_text(encoding="utf-8")
    filled = Template(text).substitute(
        helpers=HELPERS, lanes=LANES, constants=max(1, len(rows.constants)), inputs=max(1, first), outputs=max(1, place),
        load=indented([line for line in load if any(line.split()[3] in other for other in (*prepare.lines, *gather))]),
        prepare=indented(plain_lines(prepare)), fixed=indented(rows.statements(fixed, own_sine=False)),
        offsets=indented(offsets), body=indented(rows.statements(
            [target for target in rows.targets if rows.moves[target[1]]], own_sine=False)),
        gather=indented(gather, 8), scatter=indented(scatter, 8),
    )  # fmt: skip
    return Source(filled, rows.operations)
