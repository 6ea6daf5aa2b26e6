"""The substep scan of a drive with friction: a small C kernel, and the same algorithm in plain Python.

Both advance z by a matrix exponential per substep, in one of two modes: sliding (friction constant over the
substep) or stuck (x and v frozen, the rest goes on); LuGre friction has its own bristle state instead.
"""

import ctypes
import hashlib
import os
import subprocess
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from .chain import Array

Scan = Callable[..., Array]

KERNEL = r"""
#include <math.h>
static double level(const double *f, double v) {
  double g = f[0];
  if (f[1] > f[0]) g += (f[1] - f[0]) * exp(-(v / f[2]) * (v / f[2]));
  return g * (v > 0 ? 1.0 + f[5] : (v < 0 ? 1.0 - f[5] : 1.0));
}
void drive(int rows, int sub, int n, double dt, const double *c, const double *P, const double *G,
           const double *Ps, const double *Gs, const double *A, const double *B, const double *f,
           double *z, double *out) {
  double h = dt / sub, y[8], zb = 0.0, fr = 0.0;
  int s = 0, lugre = f[3] > 0;
  for (int k = 0; k < rows; k++) {
    double *o = out + k * (n + 1), rate = k + 1 < rows ? (c[k + 1] - c[k]) / dt : 0.0;
    double u = B[3] * c[k] + B[4] * rate - fr;
    for (int j = 0; j < n; j++) { o[j] = z[j]; u += A[n + j] * z[j]; }
    o[n] = (!lugre && s == 0) ? 0.0 : u;
    if (k + 1 == rows) break;
    for (int i = 0; i < sub; i++) {
      double c0 = c[k] + rate * h * i, c1 = c0 + rate * h;
      int stuck = !lugre && s == 0;
      const double *p = stuck ? Ps : P, *g = stuck ? Gs : G;
      if (lugre) {
        double gl = level(f, z[1]), zss = z[1] >= 0 ? gl / f[3] : -gl / f[3], z0 = zb;
        zb = zss + (zb - zss) * exp(-f[3] * fabs(z[1]) * h / gl);
        fr = f[3] * zb + f[4] * (zb - z0) / h;
      } else fr = s * level(f, s * fmax(fabs(z[1]), 1e-12));
      for (int r = 0; r < n; r++) {
        y[r] = g[3 * r] * c0 + g[3 * r + 1] * rate - g[3 * r + 2] * fr;
        for (int j = 0; j < n; j++) y[r] += p[r * n + j] * z[j];
      }
      if (!lugre && s && y[1] * s <= 0) { /* the speed passes zero: stand there */
        double tau = z[1] / (z[1] - y[1]);
        if (tau > 0 && tau <= 1) y[0] = z[0] + 0.5 * z[1] * tau * h;
        y[1] = 0;
        s = 0;
      }
      if (!lugre && s == 0) { /* break away where the motor's pull exceeds the level */
        double w = B[3] * c1 + B[4] * rate;
        for (int j = 0; j < n; j++) w += A[n + j] * y[j];
        double dir = w > 0 ? 1.0 : -1.0;
        if (fabs(w) > level(f, dir * 1e-12)) s = (int)dir;
      }
      for (int r = 0; r < n; r++) z[r] = y[r];
    }
  }
}
"""


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL | None:
    """The compiled kernel, None where there is no C compiler."""
    target = (
        Path(tempfile.gettempdir()) / f"symfive-plant-{os.getuid()}-{hashlib.sha1(KERNEL.encode()).hexdigest()[:12]}.so"
    )
    try:
        if not target.exists():
            with tempfile.TemporaryDirectory() as folder:
                source, built = Path(folder) / "drive.c", Path(folder) / "drive.so"
                source.write_text(KERNEL)
                subprocess.run(
                    ["gcc", "-O2", "-shared", "-fPIC", "-o", str(built), str(source), "-lm"],
                    check=True,
                    capture_output=True,
                )
                fresh = target.with_suffix(f".{os.getpid()}")
                fresh.write_bytes(built.read_bytes())
                os.replace(fresh, target)
        return ctypes.CDLL(str(target))
    except (OSError, subprocess.CalledProcessError):
        return None


def compiled_scan() -> Scan | None:
    """The C kernel as a function, None where there is no compiler."""
    library = _library()
    if library is None:
        return None

    def pointer(x: Array) -> ctypes.c_void_p:
        return ctypes.c_void_p(x.ctypes.data)

    def run(c, dt, sub, p, g, ps, gs, a, b, levels, z) -> Array:
        out = np.empty((len(c), len(z) + 1))
        arrays = [np.ascontiguousarray(x) for x in (c, p, g, ps, gs, a, b, levels, z)]
        library.drive(len(c), sub, len(z), ctypes.c_double(dt), *[pointer(x) for x in arrays], pointer(out))
        return out

    return run


def python_scan(c, dt, sub, p, g, ps, gs, a, b, levels, z) -> Array:
    """The kernel in plain Python: same algorithm, for machines without a compiler."""
    fc, fs, vs, s0, s1, asym = levels
    h, bristle, s, rub = dt / sub, 0.0, 0, 0.0
    out = np.empty((len(c), len(z) + 1))

    def level(v: float) -> float:
        return (fc + (fs - fc) * np.exp(-((v / vs) ** 2))) * (1.0 + np.sign(v) * asym)

    for k in range(len(c)):
        rate = (c[k + 1] - c[k]) / dt if k + 1 < len(c) else 0.0
        slides = s0 > 0.0 or s != 0
        out[k, :-1], out[k, -1] = z, (a[1] @ z + b[1, 0] * c[k] + b[1, 1] * rate - rub) * slides
        for i in range(sub if k + 1 < len(c) else 0):
            c0 = c[k] + rate * h * i
            if s0 > 0.0:
                ss, old = np.sign(z[1]) * level(z[1]) / s0, bristle
                bristle = ss + (bristle - ss) * np.exp(-s0 * abs(z[1]) * h / level(z[1]))
                rub = s0 * bristle + s1 * (bristle - old) / h
            else:
                rub = s * level(s * max(abs(z[1]), 1e-12))
            phi, gain = (p, g) if s0 > 0.0 or s else (ps, gs)
            y = phi @ z + gain @ np.array([c0, rate, -rub])
            if s0 == 0.0:
                if s and y[1] * s <= 0.0:
                    tau = z[1] / (z[1] - y[1]) if z[1] != y[1] else 0.0
                    if 0.0 < tau <= 1.0:
                        y[0] = z[0] + 0.5 * z[1] * tau * h
                    y[1], s = 0.0, 0
                if s == 0:
                    w = a[1] @ y + b[1, 0] * (c0 + rate * h) + b[1, 1] * rate
                    if abs(w) > level(np.sign(w) * 1e-12):
                        s = int(np.sign(w))
            z = y
    return out
