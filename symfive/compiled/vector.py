"""A slice of the graph as statements over whole vectors of rows; what is the same for all rows is computed once before."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files

from symfive.compiled.graph import Graph, Node
from symfive.compiled.scalar import CALLS, ONE, TWO, Body, number, scalar_body

HELPERS = (files("symfive.compiled") / "templates" / "helpers.c").read_text(encoding="utf-8").rstrip("\n")
"""C of the vector types and of what the statements call."""
LANES = (files("symfive.compiled") / "templates" / "lanes.c").read_text(encoding="utf-8").rstrip("\n")
"""C that defines LANES: the doubles in a register of the instruction set that is compiled for, so that no vector is emulated."""

INLINE = 60
_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
_COMPARE = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
_REPEATED = ("sq", "twice", "sign", "fmin", "fmax")


@dataclass(frozen=True)
class Rows:
    """Results of a graph over rows: `moving` inputs change from row to row, the others are held for all of them.

    `targets`: where each result goes, as `place[3] = %s;`, and its node.
    """

    graph: Graph
    moving: tuple[str, ...]
    targets: Sequence[tuple[str, int]]

    @cached_property
    def moves(self) -> list[bool]:
        """For every node whether it changes from row to row."""
        each = [self.graph.depends(name) for name in self.moving]
        return [any(flags) for flags in zip(*each, strict=True)] if each else [False] * len(self.graph.nodes)

    @cached_property
    def constants(self) -> dict[int, int]:
        """Nodes that are the same for all rows but are needed by what is not, and their places in the array c."""
        graph = self.graph
        order = graph.slice([node for _, node in self.targets])
        needed = {a for i in order if self.moves[i] for a in graph.nodes[i].args}
        needed |= {node for _, node in self.targets}
        fixed = sorted(i for i in needed if not self.moves[i] and graph.nodes[i].op != "const")
        return {node: place for place, node in enumerate(fixed)}

    @property
    def operations(self) -> int:
        """Operations a row, without what is done once."""
        order = self.graph.slice([node for _, node in self.targets])
        return self.graph.operations([i for i in order if self.moves[i]])

    def prepare(self) -> Body:
        """What is done once: assigns the array c."""
        return scalar_body(self.graph, [(f"c[{place}]", node) for node, place in self.constants.items()], "x")

    def statements(self, targets: Sequence[tuple[str, int]], *, own_sine: bool = True) -> list[str]:
        """Statements over vectors `v`; an input that moves is an array of vectors, c[i] a number for all lanes.

        `own_sine`: by the vector's own `sine_cosine`, otherwise lane by lane by the mathematical library.
        """
        graph = self.graph
        order = graph.slice([node for _, node in targets])
        uses = Counter(a for i in order for a in graph.nodes[i].args * (1 + (graph.nodes[i].op in _REPEATED)))
        written: dict[int, list[str]] = {}
        for place, root in targets:
            written.setdefault(root, []).append(place)
        names: dict[int, str] = {}
        angles: set[int] = set()
        lines: list[str] = []
        for index in order:
            node = graph.nodes[index]
            if node.op == "const":
                names[index] = number(node.value)
            elif index in self.constants:
                names[index] = f"c[{self.constants[index]}]"
            elif not self.moves[index]:
                continue
            elif node.op == "input":
                names[index] = node.text
            elif node.op in ("sin", "cos") and own_sine:
                angle = node.args[0]
                if angle not in angles:
                    angles.add(angle)
                    lines += [f"v s{angle}, c{angle};", f"sine_cosine({names[angle]}, &s{angle}, &c{angle});"]
                names[index] = f"{node.op[0]}{angle}"
            else:
                text = self._operation(node, names)
                if uses[index] == 1 and index not in written and len(text) <= INLINE and node.op in _INFIX:
                    names[index] = f"({text})"
                else:
                    names[index] = f"t{index}"
                    lines.append(f"const v t{index} = {text};")
            lines += [text % self._spread(index, names) for text in written.get(index, ())]
        return lines

    def _spread(self, index: int, names: Mapping[int, str]) -> str:
        """A vector of the value; a number less zero in every lane is that number, the sign of its zero included."""
        return names[index] if self.moves[index] else f"({names[index]} - zero)"

    def _operation(self, node: Node, names: Mapping[int, str]) -> str:
        """One operation over vectors. A comparison gives 1 or 0 in every lane."""
        op = node.op
        if op in _INFIX:
            return f"{names[node.args[0]]} {_INFIX[op]} {names[node.args[-1]]}"
        a, b = (self._spread(node.args[k], names) for k in (0, -1))
        if op in _COMPARE:
            return f"flag({a} {_COMPARE[op]} {b})"
        written = {
            "fabs": f"(v)((w)({a}) & 0x7fffffffffffffffLL)",
            "neg": f"-{a}", "sq": f"{a} * {a}", "twice": f"{a} + {a}", "inv": f"1.0 / {a}",
            "if_else_zero": f"where({a} != zero, {b}, zero)",
            "fmin": f"where(({a} <= {b}) | ({b} != {b}), {a}, {b})",
            "fmax": f"where(({a} >= {b}) | ({b} != {b}), {a}, {b})",
            "not": f"flag({a} == zero)",
            "and": f"flag(({a} != zero) & ({b} != zero))",
            "or": f"flag(({a} != zero) | ({b} != zero))",
            "sign": f"where({a} > zero, zero + 1.0, where({a} < zero, zero - 1.0, {a}))",
        }  # fmt: skip
        if op in written:
            return written[op]
        if op in ONE:
            return f"lanes({op}, {a})"
        if op in (*TWO, "constpow"):
            return f"lane_pairs({'pow' if op == 'constpow' else op}, {a}, {b})"
        raise NotImplementedError(f"no vectors for the operation {op}")


def plain_lines(body: Body) -> list[str]:
    """The lines of a body made with the prefix `x`, in plain double precision."""
    lines = [line.replace("x_real", "double") for line in body.lines]
    for name in CALLS:
        lines = [line.replace(f"X_{name.upper()}(", f"{name}(") for line in lines]
    return lines


def indented(lines: Sequence[str], by: int = 4) -> str:
    """Lines as a text, moved to the right."""
    return "\n".join(" " * by + line for line in lines)
