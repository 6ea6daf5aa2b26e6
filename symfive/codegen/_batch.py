"""The batch kernel: a slice of the graph over whole vectors of poses, what the parameters alone decide computed once."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

from symfive.codegen._graph import Node
from symfive.codegen._scalar import number, scalar_body
from symfive.codegen._sources import Sources, filled

__all__ = ["Batch"]

BLOCK = 4
L2_BYTES = 96_000
VECTOR_BYTES = 64
INLINE = 60
_INFIX = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
_COMPARE = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
_REPEATED = ("sq", "twice", "sign", "fmin", "fmax")
_LANEWISE = ("tan", "asin", "acos", "atan", "exp", "log", "sqrt", "fabs", "floor", "ceil", "sinh", "cosh", "tanh")
_LANEWISE_PAIRS = ("atan2", "pow", "constpow")


@dataclass(frozen=True)
class Batch:
    """Header and source of the batch functions of one subject (double precision, GCC or Clang)."""

    sources: Sources

    @cached_property
    def _moving(self) -> list[bool]:
        return self.sources.graph.depends("q")

    @cached_property
    def _targets(self) -> list[tuple[str, int]]:
        """Where each result goes: the point, then the Jacobian's column k, component i."""
        outputs = self.sources.graph.outputs
        found = [(f"position[{i}] = %s;", node) for i, node in enumerate(outputs["position"])]
        return found + [(f"PUT({j // 3}U, {j % 3}U, %s);", node) for j, node in enumerate(outputs["position_by_p"])]

    @cached_property
    def constants(self) -> dict[int, int]:
        """Nodes that do not depend on q but are needed by what does, and their places in the array c."""
        graph = self.sources.graph
        order = graph.slice([node for _, node in self._targets])
        needed = {a for i in order if self._moving[i] for a in graph.nodes[i].args}
        needed |= {node for _, node in self._targets}
        fixed = sorted(i for i in needed if not self._moving[i] and graph.nodes[i].op != "const")
        return {node: place for place, node in enumerate(fixed)}

    @property
    def operations(self) -> int:
        """Operations a pose of point and Jacobian, without what is done once."""
        graph = self.sources.graph
        order = graph.slice([node for _, node in self._targets])
        return graph.operations([i for i in order if self._moving[i]])

    @property
    def tiles(self) -> int:
        """Vectors of poses that the information matrix takes at a time, so that they stay in the second-level cache."""
        return max(1, min(16, L2_BYTES // (3 * VECTOR_BYTES * self.columns)))

    @property
    def columns(self) -> int:
        """Columns of the Jacobian and the residual, filled up to whole blocks."""
        return -(-(self.sources.parameters + 1) // BLOCK) * BLOCK

    @property
    def names(self) -> dict[str, object]:
        """What the templates of the batch kernel and the loader may use."""
        blocks = (self.columns // BLOCK) * (self.columns // BLOCK + 1) // 2
        vectors = self.columns * 3 * self.tiles + blocks * BLOCK * BLOCK
        return {**self.sources.names, "constants": max(1, len(self.constants)), "columns": self.columns,
                "chunk": self.tiles, "vectors": vectors, "operations": self.operations}  # fmt: skip

    def header(self) -> str:
        """The header of the batch functions."""
        return filled("batch.h", **self.names)

    def source(self) -> str:
        """The source of the batch functions."""
        graph = self.sources.graph
        targets = [(f"c[{place}]", node) for node, place in self.constants.items()]
        prepare = scalar_body(graph, targets, "x")
        lines = [line.replace("x_real", "double").replace("X_POW", "pow") for line in prepare.lines]
        for name in ("SIN", "COS", *(n.upper() for n in (*_LANEWISE, *_LANEWISE_PAIRS)), "FMIN", "FMAX"):
            lines = [line.replace(f"X_{name}(", f"{name.lower()}(") for line in lines]
        lines += [f"(void){name};" for name in ("tool", "p") if name not in prepare.reads]
        lines += [] if self.constants else ["c[0] = 0.0;"]
        points = self._tile(self._targets[:3])
        every = self._tile(self._targets)
        return filled(
            "batch.c",
            prepare=_indented(lines),
            point_body=_indented(points),
            jacobian_body=_indented(every),
            **self.names,
        )

    def _tile(self, targets: list[tuple[str, int]]) -> list[str]:
        """Statements over vectors `v`; q[i] is a vector, c[i] a number for all lanes."""
        graph = self.sources.graph
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
            elif not self._moving[index]:
                continue
            elif node.op == "input":
                names[index] = node.text
            elif node.op in ("sin", "cos"):
                angle = node.args[0]
                if angle not in angles:
                    angles.add(angle)
                    lines += [f"v s{angle}, c{angle};", f"sine_cosine({names[angle]}, &s{angle}, &c{angle});"]
                names[index] = f"{node.op[0]}{angle}"
            else:
                text = _vector(node, [names[a] for a in node.args])
                if uses[index] == 1 and index not in written and len(text) <= INLINE and node.op in _INFIX:
                    names[index] = f"({text})"
                else:
                    names[index] = f"t{index}"
                    lines.append(f"const v t{index} = {text};")
            value = names[index] if self._moving[index] else f"(zero + {names[index]})"
            lines += [text % value for text in written.get(index, ())]
        return lines


def _vector(node: Node, args: list[str]) -> str:
    """One operation over vectors. A comparison gives 1 or 0 in every lane."""
    a, b = args[0], args[-1]
    op = node.op
    if op in _INFIX:
        return f"{a} {_INFIX[op]} {b}"
    if op in _COMPARE:
        return f"flag((zero + {a}) {_COMPARE[op]} (zero + {b}))"
    if op in _LANEWISE:
        return f"lanes({op}, {a})"
    if op in _LANEWISE_PAIRS:
        return f"lane_pairs({'pow' if op == 'constpow' else op}, zero + {a}, zero + {b})"
    return {
        "neg": f"-{a}", "sq": f"{a} * {a}", "twice": f"{a} + {a}", "inv": f"1.0 / {a}",
        "if_else_zero": f"where((zero + {a}) != zero, zero + {b}, zero)",
        "fmin": f"where((zero + {a}) < (zero + {b}), zero + {a}, zero + {b})",
        "fmax": f"where((zero + {a}) > (zero + {b}), zero + {a}, zero + {b})",
        "not": f"flag((zero + {a}) == zero)",
        "and": f"flag(((zero + {a}) != zero) & ((zero + {b}) != zero))",
        "or": f"flag(((zero + {a}) != zero) | ((zero + {b}) != zero))",
        "sign": f"flag((zero + {a}) > zero) - flag((zero + {a}) < zero)",
    }[op]  # fmt: skip


def _indented(lines: list[str]) -> str:
    return "\n".join(f"    {line}" for line in lines)
