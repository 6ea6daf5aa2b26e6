"""Header and source of the scalar functions: one slice of the graph each, the iterations around them from templates."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from string import Template

import numpy as np

from symfive.codegen._chain import TOOL_AXIS, Chain, chain_of
from symfive.codegen._subject import Subject
from symfive.compiled.graph import Graph, graph_of
from symfive.compiled.scalar import CALLS, Body, number, scalar_body
from symfive.drawing import PAGE_STYLE
from symfive.machine import Machine
from symfive.version import __version__

REAL_BYTES = 8
FRAME_BYTES = 256

FUNCTIONS: dict[str, dict[str, str]] = {
    "forward": {"position": "position", "direction": "direction"},
    "nominal": {"position": "nominal_position", "direction": "nominal_direction"},
    "axis_jacobian": {"by_q": "position_by_q", "direction_by_q": "direction_by_q"},
    "parameter_jacobian": {"by_p": "position_by_p"},
    "direction_jacobian": {"direction_by_p": "direction_by_p"},
    "nominal_slope": {"position": "nominal_position", "slope": "nominal_slope"},
    "real_slope": {"position": "position", "slope": "real_slope"},
}
"""Name of each function made of a slice: its output arrays and the expressions they hold."""
_BY_P = ("parameter_jacobian", "direction_jacobian")
_LOCAL = ("nominal_slope", "real_slope")


def filled(name: str, **values: object) -> str:
    """A template of this room with its placeholders filled in."""
    text = (files("symfive.codegen") / "templates" / name).read_text(encoding="utf-8")
    return Template(text).substitute(values)


def page(name: str, title: str, **values: object) -> str:
    """A page: its template after the head that all of them share; `title` escaped."""
    return filled(name, head=filled("head.html", title=title, style=PAGE_STYLE), **values)


def solved_axes(machine: Machine) -> tuple[str, ...]:
    """The three linear axes that an inverse solves for (X, Y, Z where they exist); fewer where there are fewer."""
    first = [name for name in "XYZ" if name in machine.linear_axes]
    return tuple((first + [name for name in machine.linear_axes if name not in first])[:3])


def turning_axes(machine: Machine) -> tuple[str, ...]:
    """The two rotary axes, the workpiece's first, that can give the tool a direction; empty where there are no such two."""
    along = (*machine.structure.workpiece, *machine.structure.tool)
    rotary = [name for name in along if machine.axes[name].rotary]
    if len(rotary) != 2:
        return ()
    first, second = (np.asarray(machine.axes[name].direction) for name in rotary)
    apart = np.linalg.norm(np.cross(first, second)), np.linalg.norm(np.cross(second, TOOL_AXIS))
    return tuple(rotary) if min(apart) > 1e-3 else ()


@dataclass(frozen=True)
class Sources:
    """All that the C files of one subject have in common."""

    subject: Subject
    prefix: str

    @cached_property
    def chain(self) -> Chain:
        """The symbolic expressions."""
        return chain_of(self.subject)

    @cached_property
    def graph(self) -> Graph:
        """One graph of all functions; each function is a slice of it."""
        chain, places = self.chain, self.solved
        outputs = {name: getattr(chain, name) for names in FUNCTIONS.values() for name in names.values()
                   if not name.endswith("_slope")}  # fmt: skip
        if places:
            outputs["nominal_slope"] = chain.nominal_position_by_q[:, list(places)]
            outputs["real_slope"] = chain.position_by_q[:, list(places)]
        return graph_of({"q": chain.q, "tool": chain.tool, "p": chain.p}, outputs)

    @property
    def machine(self) -> Machine:
        return self.subject.machine

    @property
    def axes(self) -> int:
        """How many axes there are."""
        return len(self.subject.axes)

    @property
    def parameters(self) -> int:
        """How many parameters there are."""
        return len(self.subject.parameters)

    @property
    def solved(self) -> tuple[int, ...]:
        """Places in q of the axes that an inverse solves for; empty where there are fewer than three."""
        names = solved_axes(self.machine)
        return tuple(self.subject.axes.index(name) for name in names) if len(names) == 3 else ()

    @property
    def turning(self) -> tuple[str, ...]:
        """The rotary axes that an orientation solves for, where the point can be solved for too."""
        return turning_axes(self.machine) if self.solved else ()

    @cached_property
    def bodies(self) -> dict[str, Body]:
        """The bodies of the functions that this machine has."""
        found = {}
        for name, outputs in FUNCTIONS.items():
            if (name in _LOCAL and not self.solved) or (name in _BY_P and not self.parameters):
                continue
            targets = [
                (f"{array}[{place}]", node)
                for array, expression in outputs.items()
                for place, node in enumerate(self.graph.outputs[expression])
            ]
            found[name] = scalar_body(self.graph, targets, self.prefix)
        return found

    @property
    def names(self) -> dict[str, object]:
        """What every template may use."""
        return {"prefix": self.prefix, "PREFIX": self.prefix.upper(), "version": __version__,
                "digest": self.subject.digest, "machine": _plain(self.machine.name),
                "structure": self.machine.structure.code, "axes": self.axes, "parameters": self.parameters,
                "p_size": max(1, self.parameters)}  # fmt: skip

    def header(self) -> str:
        more = filled("parameter_jacobian.h", **self.names) if self.parameters else ""
        if self.solved:
            more += filled("inverse.h", solved=", ".join(solved_axes(self.machine)), **self.names)
        if self.turning:
            both = {"first": self.turning[0], "second": self.turning[1], "solved": ", ".join(solved_axes(self.machine))}
            more += filled("orient.h", **both, **self.names) + filled("compensate_direction.h", **both, **self.names)
        left_out = (f" *   left out     {_plain(key)}: {reason}\n" for key, reason in self.subject.left_out)
        return filled(
            "kinematics.h", more=more, axis_list=self._axis_list(), parameter_list=self._parameter_list(),
            cost_list=self._cost_list(), left_out="".join(left_out), **self.names,
            values_from="identified" if self.subject.fitted else "prior means (nothing is identified yet)",
        )  # fmt: skip

    def source(self) -> str:
        """The source of the scalar functions."""
        parts = [self._names_and_error()]
        parts += [self._function(name, body) for name, body in self.bodies.items()]
        if self.solved:
            places = ", ".join(map(str, self.solved))
            parts.append(filled("inverse.c", solved_places=places, **self.names))
        if self.turning:
            parts += [filled("orient.c", **self._turning_values(), **self.names),
                      filled("compensate_direction.c", **self._turning_values(), **self.names)]  # fmt: skip
        functions = "\n".join(parts)
        used = [name for name in CALLS if name == "fabs" or f"{self.prefix.upper()}_{name.upper()}(" in functions]
        return filled(
            "kinematics.c", functions=functions.rstrip("\n"), **self.names,
            float_macros=self._macros(used, "f", "1.0e-5", "1.0e-6", "1.0e-3"),
            double_macros=self._macros(used, "", "1.0e-12", "1.0e-12", "1.0e-6"),
        )  # fmt: skip

    def _macros(self, used: list[str], ending: str, turn: str, slack: str, narrowest: str) -> str:
        macro, real = self.prefix.upper(), f"{self.prefix}_real"
        lines = [f"#define {macro}_{name.upper()} {name}{ending}" for name in used]
        if self.turning:
            lines += [f"#define {macro}_LAST_TURN (({real}){turn})", f"#define {macro}_SLACK (({real}){slack})",
                      f"#define {macro}_NARROWEST (({real}){narrowest})"]  # fmt: skip
        return "\n".join(lines)

    def _function(self, name: str, body: Body) -> str:
        real, macro = f"{self.prefix}_real", self.prefix.upper()
        sizes = {"position": "3", "direction": "3", "by_q": f"3 * {macro}_AXES", "direction_by_q": f"3 * {macro}_AXES",
                 "by_p": f"3 * {macro}_PARAMETERS", "direction_by_p": f"3 * {macro}_PARAMETERS", "slope": "9"}  # fmt: skip
        arguments = [f"const {real} q[{macro}_AXES]", f"const {real} tool[3]"]
        given = ["q", "tool"]
        if name not in ("nominal", "nominal_slope"):
            arguments.append(f"const {real} p[{macro}_P_SIZE]")
            given.append("p")
        arguments += [f"{real} {array}[{sizes[array]}]" for array in FUNCTIONS[name]]
        local = name in _LOCAL
        title = f"static void {name}(" if local else f"int {self.prefix}_{name}("
        whole = title + ", ".join(arguments).replace(" * ", "~*~") + ")"
        head = textwrap.fill(whole, 116, subsequent_indent=" " * len(title), break_long_words=False).replace("~", " ")
        if local:
            lines = _declared_first(body.lines, [f"(void){array};" for array in given if array not in body.reads])
        else:
            check = ["", "if (sound_parameters(p) == 0) {", "    given = 0;", "}"] if "p" in given else []
            results = [f"(sound({sizes[array]}, {array}, ({real}){macro}_LARGEST) != 0)" for array in FUNCTIONS[name]]
            lines = ["int given = sound_pose(q, tool);", *check, "", *body.lines, "",
                     f"return ((given != 0) && {' && '.join(results)}) ? {macro}_OK : {macro}_INVALID;"]  # fmt: skip
        return "\n".join([head, "{", *(f"    {line}" if line else "" for line in lines), "}", ""])

    def _turning_values(self) -> dict[str, object]:
        real = f"{self.prefix}_real"
        first, second = (np.asarray(self.machine.axes[name].direction) for name in self.turning)
        places = [self.subject.axes.index(name) for name in self.turning]

        def vector(v: object) -> str:
            return ", ".join(f"({real}){number(x)}" for x in np.asarray(v))

        return {
            "first_axis": vector(first), "second_axis": vector(second), "normal_axis": vector(np.cross(first, second)),
            "first_place": places[0], "second_place": places[1], "first_column": 3 * places[0],
            "second_column": 3 * places[1],
        }  # fmt: skip

    def _names_and_error(self) -> str:
        names = [p.name for p in self.subject.parameters]
        assignments = [
            f"    p[{i}] = ({self.prefix}_real){number(value)}; /* {_plain(p.name)}, {p.unit} */"
            for i, (p, value) in enumerate(zip(self.subject.parameters, self.subject.values, strict=True))
        ] or [f"    p[0] = ({self.prefix}_real)0.0; /* no parameter */"]
        quoted = [f'        "{_plain(name)}"' for name in names or [""]]
        return filled("names.c", assignments="\n".join(assignments), names=",\n".join(quoted), **self.names)

    def _axis_list(self) -> str:
        lines = []
        for i, name in enumerate(self.subject.axes):
            axis = self.machine.axes[name]
            direction = ", ".join(f"{v:.9g}" for v in axis.direction)
            place = f", through ({', '.join(f'{v:.9g}' for v in axis.origin)}) mm" if axis.rotary else ""
            low, high = (f"{v:.9g}" for v in axis.travel)
            side = self.machine.structure.carries(name)
            lines.append(f" *   q[{i}] {name}, {'rad' if axis.rotary else 'mm'}: {axis.kind}, carries the {side}, "
                         f"direction ({direction}){place}, travel {low} ... {high} {axis.unit}")  # fmt: skip
        return "".join(f"{line}\n" for line in lines)

    def _parameter_list(self) -> str:
        parameters = self.subject.parameters
        if not parameters:
            return " *   none: the machine file varies no error\n"
        return "".join(f" *   p[{i}] {_plain(p.name)}, {p.unit}\n" for i, p in enumerate(parameters))

    def _cost_list(self) -> str:
        found = ""
        for name, body in self.bodies.items():
            shown = f"({name})" if name in _LOCAL else f"{self.prefix}_{name}"
            bound = REAL_BYTES * body.variables + FRAME_BYTES
            found += f" *   {shown}: {body.operations} operations, {body.live} live, at most {bound} bytes\n"
        if self.solved:
            found += " *   An inverse takes 2 or 3 steps of (real_slope), one of (nominal_slope), and 1000 bytes beyond theirs.\n"
        return found


def _declared_first(lines: tuple[str, ...], unused: list[str]) -> list[str]:
    """Statements that mark unused arguments stand after the last declaration of the leading block."""
    leading = next((i for i, line in enumerate(lines) if not line.startswith("const ")), len(lines))
    gap = [""] if leading else []
    return [*lines[:leading], *gap, *unused, *lines[leading:]]


def _plain(text: str) -> str:
    """Text that can stand in a C comment and in a C string."""
    plain = "".join(c if " " <= c <= "~" and c not in '"\\' else "?" for c in text)
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")
