"""The model as a list of elementary operations in single assignment, cut into the slices that C functions are made of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

_NAMES = {
    getattr(ca, f"OP_{name}"): name.lower()
    for name in (
        "ADD", "SUB", "MUL", "DIV", "NEG", "SQ", "TWICE", "INV", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "ATAN2",
        "EXP", "LOG", "SQRT", "POW", "CONSTPOW", "FABS", "SIGN", "FLOOR", "CEIL", "FMIN", "FMAX", "LT", "LE", "EQ", "NE",
        "NOT", "AND", "OR", "IF_ELSE_ZERO", "SINH", "COSH", "TANH", "ASINH", "ACOSH", "ATANH", "LOG1P", "EXPM1", "ERF", "HYPOT",
        "FMOD",
    )
}  # fmt: skip
HIGHEST_HARMONIC = 60
COMMUTATIVE = ("add", "mul", "fmin", "fmax", "eq", "ne", "and", "or")


@dataclass(frozen=True)
class Node:
    """One value: `op` a name as `add`, `const` or `input`; `args` indices of earlier nodes; `text` of an input."""

    op: str
    args: tuple[int, ...] = ()
    value: float = 0.0
    text: str = ""


@dataclass(frozen=True)
class Graph:
    """All nodes in an order in which they can be computed, and the nodes of every output by name."""

    nodes: tuple[Node, ...]
    outputs: Mapping[str, tuple[int, ...]]

    def slice(self, roots: Sequence[int]) -> list[int]:
        """The nodes that the roots need, each after what it needs and as late as that allows (depth first)."""
        seen: set[int] = set()
        order: list[int] = []
        for root in roots:
            stack = [(root, False)]
            while stack:
                index, ready = stack.pop()
                if ready:
                    order.append(index)
                elif index not in seen:
                    seen.add(index)
                    stack.append((index, True))
                    stack.extend((a, False) for a in reversed(self.nodes[index].args) if a not in seen)
        return order

    def depends(self, inputs: str) -> list[bool]:
        """For every node whether it depends on the input array of that name."""
        found: list[bool] = []
        for node in self.nodes:
            own = node.op == "input" and node.text.split("[", 1)[0] == inputs
            found.append(own or any(found[a] for a in node.args))
        return found

    def operations(self, order: Sequence[int]) -> int:
        """How many arithmetic operations and function calls a slice holds."""
        return sum(self.nodes[i].op not in ("const", "input") for i in order)

    def live(self, order: Sequence[int], roots: Sequence[int]) -> int:
        """The most values that are needed at one time when the slice is computed in this order."""
        last = {a: place for place, i in enumerate(order) for a in self.nodes[i].args}
        last |= {root: max(last.get(root, 0), order.index(root)) for root in set(roots)}
        born = {i: place for place, i in enumerate(order)}
        ends = [0] * (len(order) + 1)
        for i in order:
            ends[last.get(i, born[i])] += 1
        most = count = 0
        for place, _ in enumerate(order):
            count += 1
            most = max(most, count)
            count -= ends[place]
        return most


def graph_of(inputs: Mapping[str, Any], outputs: Mapping[str, Any]) -> Graph:
    """The graph of symbolic expressions; common subexpressions once, rewritten where that saves operations.

    Outputs are dense, column by column."""
    dense = [ca.densify(value) for value in outputs.values()]
    function = ca.Function("graph", list(inputs.values()), dense, {"cse": True})
    return _graph(function, list(inputs), list(outputs), exact=False)


def exact_graph(function: Any, inputs: Sequence[str], outputs: Sequence[str]) -> Graph:
    """The graph of a CasADi function of scalars (SX) with dense arguments, under the given names.

    Every operation is the function's own in its order, those that occur twice once: evaluated in double precision without
    contraction it gives the same bits. Raises `NotImplementedError` for an operation that is not written in C here.
    """
    return _graph(function, inputs, outputs, exact=True)


def _graph(function: Any, names: Sequence[str], results: Sequence[str], *, exact: bool) -> Graph:
    nodes: list[Node] = []
    known: dict[Node, int] = {}
    work: dict[int, int] = {}
    found: dict[str, list[int]] = {name: [-1] * function.nnz_out(i) for i, name in enumerate(results)}

    def add(node: Node) -> int:
        if node not in known:
            known[node] = len(nodes)
            nodes.append(node)
        return known[node]

    for k in range(function.n_instructions()):
        op = function.instruction_id(k)
        if op == ca.OP_CONST:
            work[function.instruction_output(k)[0]] = add(_constant(float(function.instruction_constant(k))))
        elif op == ca.OP_INPUT:
            which, place = function.instruction_input(k)
            work[function.instruction_output(k)[0]] = add(Node("input", text=f"{names[which]}[{place}]"))
        elif op == ca.OP_OUTPUT:
            which, place = function.instruction_output(k)
            found[results[which]][place] = work[function.instruction_input(k)[0]]
        elif op == ca.OP_ASSIGN:
            work[function.instruction_output(k)[0]] = work[function.instruction_input(k)[0]]
        elif op in _NAMES:
            args = tuple(work[i] for i in function.instruction_input(k))
            name = _NAMES[op]
            if exact:
                made = add(Node(name, tuple(sorted(args)) if name in ("add", "mul") else args))
            else:
                made = _simplest(add, nodes, name, args)
            work[function.instruction_output(k)[0]] = made
        else:
            raise NotImplementedError(f"no C for CasADi's operation {op}")
    return Graph(tuple(nodes), {name: tuple(values) for name, values in found.items()})


def _constant(value: float) -> Node:
    """A number; its text tells -0 from 0, which are equal."""
    return Node("const", value=value, text=repr(value))


def _simplest(add: Any, nodes: list[Node], op: str, args: tuple[int, ...]) -> int:
    """The node of an operation after rewritings that change its value by a rounding at most: x + (-y) = x - y, …"""
    first = nodes[args[0]]
    if op == "mul" and (first.op == "neg") != (nodes[args[1]].op == "neg"):
        inner, other = (first.args[0], args[1]) if first.op == "neg" else (nodes[args[1]].args[0], args[0])
        return _simplest(add, nodes, "neg", (add(Node("mul", tuple(sorted((inner, other))))),))
    if op == "neg" and first.op == "neg":
        return first.args[0]
    if op == "neg" and first.op == "sub":
        return int(add(Node("sub", (first.args[1], first.args[0]))))
    if op == "neg" and first.op == "const":
        return int(add(_constant(-first.value)))
    if op in ("add", "sub"):
        second = nodes[args[1]]
        if second.op == "neg":
            return int(add(Node("sub" if op == "add" else "add", (args[0], second.args[0]))))
        if op == "add" and first.op == "neg":
            return int(add(Node("sub", (args[1], first.args[0]))))
    if op == "sin" and first.op == "neg":
        return int(add(Node("neg", (add(Node("sin", first.args)),))))
    if op in ("sin", "cos") and (times := _harmonic(nodes, first)) is not None:
        return _multiple_angle(add, nodes, *times)[op == "sin"]
    if op == "div" and nodes[args[1]].op == "const":
        return int(add(Node("mul", tuple(sorted((args[0], add(_constant(1.0 / nodes[args[1]].value))))))))
    if op == "mul" and first.op == "neg" and nodes[args[1]].op == "neg":
        return int(add(Node("mul", tuple(sorted((first.args[0], nodes[args[1]].args[0]))))))
    if op in COMMUTATIVE:
        args = tuple(sorted(args))
    return int(add(Node(op, args)))


def _harmonic(nodes: list[Node], angle: Node) -> tuple[int, int] | None:
    """(k, x) where the angle is k·x with a whole number k of at least two."""
    if angle.op == "twice":
        return 2, angle.args[0]
    if angle.op == "mul":
        for factor, x in (angle.args, angle.args[::-1]):
            node = nodes[factor]
            if node.op == "const" and node.value in range(2, HIGHEST_HARMONIC + 1):
                return int(node.value), x
    return None


def _multiple_angle(add: Any, nodes: list[Node], k: int, x: int) -> tuple[int, int]:
    """cos(k·x) and sin(k·x) from those of x by the addition theorem, which is faster than to call both again."""
    c, s = (_simplest(add, nodes, op, (x,)) for op in ("cos", "sin"))
    if k == 1:
        return c, s

    def calculated(op: str, *args: int) -> int:
        return _simplest(add, nodes, op, args)

    before_c, before_s = _multiple_angle(add, nodes, k - 1, x)
    cosine = calculated("sub", calculated("mul", before_c, c), calculated("mul", before_s, s))
    return cosine, calculated("add", calculated("mul", before_s, c), calculated("mul", before_c, s))
