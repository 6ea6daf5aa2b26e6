"""A slice of the graph as the body of a C99 function: constants first, then values that are assigned once."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from symfive.compiled.graph import Graph, Node

INLINE = 48
_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
_TWICE = ("sq", "twice", "sign")  # their argument stands twice in the text
_COMPARE = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
TWO = ("atan2", "pow", "fmin", "fmax", "hypot", "fmod")
CALLS = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sqrt", "pow", "fabs", "floor", "ceil",
         "fmin", "fmax", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "log1p", "expm1", "erf", "hypot", "fmod")  # fmt: skip
ONE = tuple(name for name in CALLS if name not in TWO)
"""Operations that C's mathematical library has under the same name, of two arguments and of one."""


@dataclass(frozen=True)
class Body:
    """The lines of a body, its `operations`, the most values `live` at one time, all `variables`, arrays it reads."""

    lines: tuple[str, ...]
    operations: int
    live: int
    variables: int
    reads: frozenset[str]


def number(value: float) -> str:
    """A number as C writes it, exact in double."""
    if not math.isfinite(value):
        return "NAN" if math.isnan(value) else "HUGE_VAL" if value > 0.0 else "(-HUGE_VAL)"
    text = repr(float(value))
    return text if any(c in text for c in ".en") else f"{text}.0"


def scalar_body(graph: Graph, targets: Sequence[tuple[str, int]], prefix: str) -> Body:
    """The body that assigns `targets` (left side, node). Every input is read before anything is written."""
    roots = [index for _, index in targets]
    order = graph.slice(roots)
    uses = Counter(a for i in order for a in graph.nodes[i].args * (1 + (graph.nodes[i].op in _TWICE)))
    written: dict[int, list[str]] = {}
    for left, index in targets:
        written.setdefault(index, []).append(left)
    names: dict[int, str] = {}
    loads: list[str] = []
    constants: list[str] = []
    lines: list[str] = []
    count = 0
    real, macro = f"{prefix}_real", prefix.upper()
    for index in order:
        node = graph.nodes[index]
        if node.op == "input":
            names[index] = node.text.replace("[", "").replace("]", "")
            loads.append(f"const {real} {names[index]} = {node.text};")
        elif node.op == "const":
            names[index] = f"k{len(constants)}"
            constants.append(f"const {real} {names[index]} = ({real})({number(node.value)});")
        else:
            text = _expression(node, [names[a] for a in node.args], real, macro)
            single = uses[index] == 1 and index not in written and len(text) <= INLINE and node.op in _INFIX
            if single:
                names[index] = f"({text})"
            elif uses[index] == 0 and index in written and len(written[index]) == 1:
                names[index] = text
            else:
                names[index] = f"t{count}"
                count += 1
                lines.append(f"const {real} {names[index]} = {text};")
        lines += [f"{left} = {_bare(names[index])};" for left in written.get(index, ())]
    loads.sort(key=_by_array_and_place)
    reads = frozenset(graph.nodes[i].text.split("[")[0] for i in order if graph.nodes[i].op == "input")
    variables = len(loads) + len(constants) + count
    return Body((*loads, *constants, *lines), graph.operations(order), graph.live(order, roots), variables, reads)


def _by_array_and_place(load: str) -> tuple[str, int]:
    array, place = load.rsplit(" = ", 1)[1].rstrip("];").split("[")
    return array, int(place)


def _bare(text: str) -> str:
    return text[1:-1] if text.startswith("(") and text.endswith(")") and text.count("(") == 1 else text


def _expression(node: Node, args: list[str], real: str, macro: str) -> str:
    a, b = args[0], args[-1]
    op = node.op
    if op in _INFIX:
        return f"{a} {_INFIX[op]} {b}"
    if op in _COMPARE:
        return f"({a} {_COMPARE[op]} {b}) ? ({real})1.0 : ({real})0.0"
    if op in CALLS:
        return f"{macro}_{op.upper()}({', '.join(args)})"
    zero = f"({real})0.0"
    return {
        "neg": f"-{a}", "sq": f"{a} * {a}", "twice": f"{a} + {a}", "inv": f"({real})1.0 / {a}",
        "constpow": f"{macro}_POW({a}, {b})", "if_else_zero": f"({a} != {zero}) ? {b} : {zero}",
        "not": f"({a} == {zero}) ? ({real})1.0 : {zero}",
        "and": f"(({a} != {zero}) && ({b} != {zero})) ? ({real})1.0 : {zero}",
        "or": f"(({a} != {zero}) || ({b} != {zero})) ? ({real})1.0 : {zero}",
        "sign": f"({a} > {zero}) ? ({real})1.0 : (({a} < {zero}) ? -({real})1.0 : {a})",
    }[op]  # fmt: skip
