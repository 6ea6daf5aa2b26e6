"""Target `c`: C99 sources with header, self-test, batch kernel, CMake file, Python loader and a page of the interface."""

from __future__ import annotations

import html
import json
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from symfive.arrays import Array
from symfive.codegen._sources import Sources, filled, page
from symfive.codegen._subject import Subject
from symfive.compiled.scalar import number
from symfive.compiled.vector import HELPERS, LANES, Rows, indented, plain_lines

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
    """The text of `…_selftest.c`: expected values from the model's chain and automatic differentiation, round trips, finite
    differences."""
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


BLOCK = 4
L2_BYTES = 96_000
VECTOR_BYTES = 64


@dataclass(frozen=True)
class Batch:
    """Header and source of the batch functions of one subject (double precision, GCC or Clang): a slice of the graph over whole
    vectors of poses, what the parameters alone decide computed once."""

    sources: Sources

    @cached_property
    def rows(self) -> Rows:
        """The point, then the Jacobian's column k, component i, over rows of q."""
        outputs = self.sources.graph.outputs
        targets = [(f"position[{i}] = %s;", node) for i, node in enumerate(outputs["position"])]
        targets += [(f"PUT({j // 3}U, {j % 3}U, %s);", node) for j, node in enumerate(outputs["position_by_p"])]
        return Rows(self.sources.graph, ("q",), targets)

    @property
    def constants(self) -> dict[int, int]:
        """Nodes that do not depend on q but are needed by what does, and their places in the array c."""
        return self.rows.constants

    @property
    def operations(self) -> int:
        """Operations a pose of point and Jacobian, without what is done once."""
        return self.rows.operations

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
        chosen = LANES.replace("LANES", f"{self.sources.prefix.upper()}_LANES")
        return filled("batch.h", lanes=chosen, **self.names)

    def source(self) -> str:
        """The source of the batch functions."""
        prepare = self.rows.prepare()
        lines = plain_lines(prepare)
        lines += [f"(void){name};" for name in ("tool", "p") if name not in prepare.reads]
        lines += [] if self.constants else ["c[0] = 0.0;"]
        points = self.rows.statements(self.rows.targets[:3])
        every = self.rows.statements(self.rows.targets)
        return filled(
            "batch.c",
            helpers=HELPERS,
            lanes=LANES,
            prepare=indented(lines),
            point_body=indented(points),
            jacobian_body=indented(every),
            **self.names,
        )


_SAYS = (
    ("parameters", "the identified values of p"),
    ("model", "SHA-256 of the model, a text"),
    ("parameter_name", "name of a parameter, a text"),
    ("forward", "the real tool's point and direction in the workpiece frame"),
    ("nominal", "the same without errors"),
    ("error", "volumetric error: real minus nominal"),
    ("axis_jacobian", "derivatives of point and direction by the axes"),
    ("parameter_jacobian", "derivatives of the point by every parameter"),
    ("direction_jacobian", "derivatives of the direction by every parameter"),
    ("inverse_nominal", "linear axes for a target, without errors"),
    ("inverse", "linear axes for a target, real machine"),
    ("compensate", "commands that put the real point where the nominal one should be"),
    ("orient", "rotary axes for a direction, without errors"),
    ("compensate_direction", "commands for point and direction of the real tool"),
)


def c_files(subject: Subject, prefix: str) -> dict[str, str]:
    """File names and their text."""
    sources = Sources(subject, prefix)
    batch = Batch(sources)
    return {
        f"{prefix}.h": sources.header(),
        f"{prefix}.c": sources.source(),
        f"{prefix}_batch.h": batch.header(),
        f"{prefix}_batch.c": batch.source(),
        f"{prefix}_selftest.c": selftest(sources),
        "CMakeLists.txt": filled("CMakeLists.txt", **sources.names),
        f"{prefix}.py": loader(sources, batch),
        f"{prefix}.html": interface(sources),
    }


def interface(sources: Sources) -> str:
    """The page of the generated interface."""
    has = {"parameter_jacobian": sources.parameters, "direction_jacobian": sources.parameters}
    has |= dict.fromkeys(("inverse_nominal", "inverse", "compensate"), len(sources.solved))
    has |= dict.fromkeys(("orient", "compensate_direction"), len(sources.turning))
    functions = []
    for name, says in _SAYS:
        if has.get(name, 1):
            body = sources.bodies.get(name)
            cost = (str(body.operations), str(body.live)) if body else ("", "")
            functions.append(_row(f"<code>{sources.prefix}_{name}</code>", says, *cost))
    subject, axes = sources.subject, []
    for i, name in enumerate(subject.axes):
        axis = subject.machine.axes[name]
        travel = f"{axis.travel[0]:g} … {axis.travel[1]:g} {axis.unit}"
        side = subject.machine.structure.carries(name)
        axes.append(_row(str(i), html.escape(name), "rad" if axis.rotary else "mm", travel, side))
    parameters = [
        _row(str(i), html.escape(p.name), html.escape(p.unit), f"{value:.6g}")
        for i, (p, value) in enumerate(zip(subject.parameters, subject.values, strict=True))
    ]
    left_out = "".join(f"<li>{html.escape(key)}: {html.escape(why)}</li>" for key, why in subject.left_out)
    escaped = {key: html.escape(str(value)) for key, value in sources.names.items()}
    return page(
        "page.html", f"{sources.prefix}: {escaped['machine']}", function_rows="\n".join(functions), axis_rows="\n".join(axes),
        parameter_rows="\n".join(parameters) or _row("", "none", "", ""),
        left_out=f"<h2>Left out</h2><ul>{left_out}</ul>" if left_out else "", **escaped,
    )  # fmt: skip


def _row(*cells: str) -> str:
    return "<tr>" + "".join(f'<td class="n">{c}</td>' if _number(c) else f"<td>{c}</td>" for c in cells) + "</tr>"


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def loader(sources: Sources, batch: Batch) -> str:
    """The Python file that calls the C functions."""
    axes = "".join(f"{json.dumps(name)}, " for name in sources.subject.axes)
    parameters = "".join(f"\n    {json.dumps(p.name)}," for p in sources.subject.parameters)
    return filled("loader.py.txt", axis_names=axes.rstrip(), parameter_names=f"{parameters}\n" if parameters else "",
                  **batch.names)  # fmt: skip
