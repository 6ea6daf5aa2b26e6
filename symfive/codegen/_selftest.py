"""The self-test in C: expected values, round trips and finite differences."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

from symfive.codegen._sources import Sources, filled
from symfive.codegen._vectors import spread_vectors
from symfive.compiled.scalar import number


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
