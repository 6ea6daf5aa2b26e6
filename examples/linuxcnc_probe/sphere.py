"""The true machine behind the joints: a HAL component that closes the probe's contact when the tip meets the sphere.

The chain is that of the conventions, section 1, written in C from the machine's table with the true location errors as constants.
It takes the joints of the servo thread and knows nothing of the control's kinematics or of symfive's.
"""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import plant
from plant.chain import location

from symfive.errors import InputError

from ..linuxcnc_loop.controller import MODULES

COMPONENT = "sfsphere"
UNIT = [1e-3] * 3 + [1e-6] * 3
_HEAD = """component {name} "sphere and touch probe behind the joints of a five-axis machine";
pin in float q-#[{joints}] "joints, mm and degree";
pin out bit contact;
pin out unsigned touches;
variable double noise;
variable unsigned state = {seed};
variable int was;
function _ fp;
license "GPL";
;;
#include <rtapi_math.h>
static void turned(const double *r, double *p) {{
  double a = r[0]*p[0] + r[1]*p[1] + r[2]*p[2], b = r[3]*p[0] + r[4]*p[1] + r[5]*p[2];
  p[2] = r[6]*p[0] + r[7]*p[1] + r[8]*p[2]; p[0] = a; p[1] = b;
}}
static void about(const double *e, double angle, double *p) {{ /* Rodrigues */
  double c = cos(angle), s = sin(angle), d = (e[0]*p[0] + e[1]*p[1] + e[2]*p[2])*(1.0 - c);
  double x = e[1]*p[2] - e[2]*p[1], y = e[2]*p[0] - e[0]*p[2], z = e[0]*p[1] - e[1]*p[0];
  p[0] = c*p[0] + s*x + d*e[0]; p[1] = c*p[1] + s*y + d*e[1]; p[2] = c*p[2] + s*z + d*e[2];
}}
static double uniform(unsigned *u) {{
  *u = *u * 1664525u + 1013904223u;
  return (*u >> 8) / 16777216.0;
}}
FUNCTION(_) {{
  double p[3] = {{ {ball} }}, t[3] = {{ {tool} }}, r = {radius} + noise, g = 0.0;
  int i;
"""
_TAIL = """  for (i = 0; i < 3; i++) g += (t[i] - p[i])*(t[i] - p[i]);
  contact = g <= r*r;
  if (was && !contact) {{ /* the next touch trips elsewhere */
    double sum = -6.0;
    for (i = 0; i < 12; i++) sum += uniform(&state);
    noise = {noise} * sum;
    touches++;
  }}
  was = contact;
}}
"""


def _row(values: Sequence[float]) -> str:
    return ", ".join(f"{float(v):.17g}" for v in np.ravel(values))


def _moved(axis: Any, joint: int, errors: Mapping[str, float], point: str) -> list[str]:
    """The lines that take a point through A(q) of an axis, outermost last."""
    place = location(axis, {k: v * UNIT[("EX", "EY", "EZ", "EA", "EB", "EC").index(k[:2])] for k, v in errors.items()})
    turn = plant.chain.rot_xyz(place[3:])
    if not axis.rotary:
        step = axis.side * (turn @ np.asarray(axis.direction))
        return [f"  {point}[{k}] += {step[k]:.17g} * q({joint});" for k in range(3)]
    origin = np.asarray(axis.origin)
    angle = f"{axis.side * np.pi / 180.0:.17g} * q({joint})"
    return [
        *(f"  {point}[{k}] -= {origin[k]:.17g};" for k in range(3)),
        f"  {{ static const double e[3] = {{ {_row(axis.direction)} }}; about(e, {angle}, {point}); }}",
        f"  {{ static const double r0[9] = {{ {_row(turn)} }}; turned(r0, {point}); }}",
        *(f"  {point}[{k}] += {origin[k] + place[k]:.17g};" for k in range(3)),
    ]


def component_text(
    table: Mapping[str, Any],
    errors: Mapping[str, float],
    letters: Sequence[str],
    *,
    ball: Sequence[float],
    tool: Sequence[float],
    radius: float,
    noise_um: float,
    seed: int,
) -> str:
    """The component for a machine.toml `table`; `errors` µm and µrad; sphere and tip, mm, `radius` of both together; `noise_um`
    1σ of the place at which one touch trips."""
    chain = plant.parse_structure(table["structure"], table["axes"])
    lines = _HEAD.format(
        name=COMPONENT, joints=len(letters), seed=seed, ball=_row(ball), tool=_row(tool), radius=f"{radius:.17g}"
    ).splitlines()
    for axes, point in ((chain.workpiece, "p"), (chain.tool, "t")):
        for axis in reversed(axes):
            lines += _moved(axis, letters.index(axis.name), errors, point)
    return "\n".join(lines) + "\n" + _TAIL.format(noise=f"{1e-3 * noise_um:.17g}")


def hal_lines(joints: int) -> tuple[str, ...]:
    """How it is wired to the configuration of `linuxcnc_loop`."""
    return (
        f"loadrt {COMPONENT}",
        f"addf {COMPONENT}.0 servo-thread",
        *(f"net joint-{i} => {COMPONENT}.0.q-{i}" for i in range(joints)),
        f"net contact {COMPONENT}.0.contact => motion.probe-input",
    )


@contextmanager
def installed(text: str, folder: Path) -> Iterator[None]:
    """The component compiled and installed; removed at the end. Raises `InputError`."""
    source = folder / f"{COMPONENT}.comp"
    source.write_text(text)
    try:
        done = subprocess.run(
            ["halcompile", "--install", source.name],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
            env=os.environ,
        )
        if done.returncode != 0:
            said = " / ".join((done.stdout + done.stderr).splitlines()[-5:])
            raise InputError(f"halcompile could not build the sphere: {said}", remedy="install linuxcnc-uspace-dev")
        yield
    finally:
        (MODULES / f"{COMPONENT}.so").unlink(missing_ok=True)
