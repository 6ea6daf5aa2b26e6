"""The sphere behind LinuxCNC's joints closes its contact where the independent plant says that the tip meets it."""

import shutil
import subprocess

import numpy as np
import plant
import pytest

from examples.linuxcnc_probe.loop import LOCATION, trunnion
from examples.linuxcnc_probe.sphere import component_text
from symfive.machine import machine_to_data

SHIM = """#include <math.h>
#include <stdio.h>
static double joint[5], noise; static unsigned state = 1, touches; static int was, contact;
#define q(i) joint[i]
#define FUNCTION(name) static void cycle(void)
"""
MAIN = """
int main(void) {
  while (scanf("%lf %lf %lf %lf %lf", joint, joint + 1, joint + 2, joint + 3, joint + 4) == 5) {
    noise = 0.0; cycle(); printf("%d\\n", contact);
  }
  return 0;
}
"""


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler (gcc)")
def test_the_contact_is_where_the_plant_says(tmp_path):
    table = machine_to_data(trunnion("table-bc"))
    table["axes"]["B"]["origin"] = [3.0, -2.0, -40.0]
    rng = np.random.default_rng(4)
    errors = {n: float(v) for n, v in zip(LOCATION, rng.normal(0.0, 60.0, 8), strict=True)}
    ball, tool, radius = np.array([90.0, -40.0, 110.0]), np.array([0.1, -0.2, -150.0]), 15.5
    text = component_text(table, errors, list("XYZBC"), ball=ball, tool=tool, radius=radius, noise_um=0.3, seed=1)
    body = text.split(";;\n", 1)[1].replace("#include <rtapi_math.h>", "")
    (tmp_path / "sphere.c").write_text(SHIM + body + MAIN)
    subprocess.run(["gcc", "-o", "sphere", "sphere.c", "-lm"], cwd=tmp_path, check=True)

    chain = plant.parse_structure(table["structure"], table["axes"])
    rotary = {"B": np.deg2rad(rng.uniform(-50.0, 50.0, 40)), "C": np.deg2rad(rng.uniform(-180.0, 180.0, 40))}
    small = {n: v * (1e-6 if n[1] in "ABC" else 1e-3) for n, v in errors.items()}
    at = plant.nominal_linear(chain, rotary, ball, tool)
    for _ in range(4):  # where the true machine has tip and sphere in one place, by differences
        q = {**at, **rotary}
        gap = plant.ball_in_workpiece(chain, q, tool, small) - ball
        slopes = [plant.ball_in_workpiece(chain, {**q, n: q[n] + 1.0}, tool, small) - ball - gap for n in "XYZ"]
        step = np.linalg.solve(np.stack(slopes, axis=2), gap[:, :, None])[:, :, 0]
        at = {n: at[n] - step[:, i] for i, n in enumerate("XYZ")}
    away = rng.normal(size=(40, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    lines, expected = [], []
    for distance, touching in ((radius - 2e-6, 1), (radius + 2e-6, 0)):  # X, Y and Z are square: 2 nm either side
        for k in range(40):
            linear = [at[n][k] + distance * away[k, i] for i, n in enumerate("XYZ")]
            lines.append(" ".join(f"{v:.12f}" for v in [*linear, *np.rad2deg([rotary["B"][k], rotary["C"][k]])]))
            expected.append(touching)
    done = subprocess.run([tmp_path / "sphere"], input="\n".join(lines), capture_output=True, text=True, check=True)
    assert [int(line) for line in done.stdout.split()] == expected
