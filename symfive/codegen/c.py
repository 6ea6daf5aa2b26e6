"""Target `c`: C99 sources with header, self-test, batch kernel, CMake file, Python loader and a page of the interface."""

from __future__ import annotations

import html
import json

from symfive.codegen._batch import Batch
from symfive.codegen._selftest import selftest
from symfive.codegen._sources import Sources, filled
from symfive.codegen._subject import Subject
from symfive.drawing import PAGE_STYLE

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
        f"{prefix}.html": page(sources),
    }


def page(sources: Sources) -> str:
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
    return filled(
        "page.html", style=PAGE_STYLE, function_rows="\n".join(functions), axis_rows="\n".join(axes),
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
