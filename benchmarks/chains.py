"""The chain of `codegen.py` written for JAX, for complex steps and for SymForce: programs that it runs."""

from __future__ import annotations

CHAIN = """
def chain(np, q, p, tool):
    # w C' B' X' Y' b Z t; q: Y X B C Z, p: six errors an axis in that order, um and urad; batched over the last axis
    def turn(k, a):
        c, s, o, z = np.cos(a), np.sin(a), np.ones_like(a), np.zeros_like(a)
        rows = ([[o, z, z], [z, c, -s], [z, s, c]], [[c, z, s], [z, o, z], [-s, z, c]], [[c, -s, z], [s, c, z], [z, z, o]])
        return np.stack([np.stack(r) for r in rows[k]])
    def mul(a, b):
        return np.einsum('ij...,jk...->ik...', a, b)
    def move(a, x):
        return np.einsum('ij...,j...->i...', a, x)
    poses = []
    for i, (kind, k, sign) in enumerate((('l', 1, -1), ('l', 0, -1), ('r', 1, -1), ('r', 2, -1), ('l', 2, 1))):
        e = p[6 * i : 6 * i + 6]
        one = np.ones_like(q[i])
        r = mul(mul(turn(0, 1e-6 * e[3] * one), turn(1, 1e-6 * e[4] * one)), turn(2, 1e-6 * e[5] * one))
        t = [1e-3 * e[j] * one for j in range(3)]
        if kind == 'l':
            t[k] = t[k] + sign * q[i]
        else:
            r = mul(r, turn(k, sign * q[i]))
        poses.append((r, np.stack(t)))
    r, t = poses[4]
    d = move(r, np.stack([np.ones_like(q[0]) * x for x in tool])) + t
    for r, t in poses[:4]:
        d = np.einsum('ji...,j...->i...', r, d - t)
    return d
"""
JAX = (
    CHAIN
    + """
import sys, time, jax, numpy
jax.config.update('jax_enable_x64', True)
import jax.numpy as jnp
n = int(sys.argv[1]); q = jnp.asarray(numpy.load(sys.argv[2])[:n]); p = jnp.asarray(numpy.load(sys.argv[3]))
point = lambda q, p: chain(jnp, q, p, (0.0, 0.0, -150.0))
f = jax.jit(jax.vmap(lambda q: (point(q, p), jax.jacrev(point, 1)(q, p))))
f(q)[1].block_until_ready(); best = 1e9
for _ in range(3):
    s = time.process_time(); d, j = f(q); j.block_until_ready(); best = min(best, time.process_time() - s)
numpy.save(sys.argv[4], numpy.asarray(j[:50])); print(best / n)
"""
)
COMPLEX = (
    CHAIN
    + """
import sys, time, numpy
n = int(sys.argv[1]); q = numpy.load(sys.argv[2])[:n].T + 0j; p = numpy.load(sys.argv[3]); best = 1e9
for _ in range(2):
    s = time.process_time(); j = numpy.empty((n, 3, 30))
    for k in range(30):
        x = p + 0j; x[k] += 1e-30j; j[:, :, k] = chain(numpy, q, x, (0.0, 0.0, -150.0)).imag.T * 1e30
    best = min(best, time.process_time() - s)
numpy.save(sys.argv[4], j[:50]); print(best / n)
"""
)
SYMFORCE = """
import ctypes, subprocess, sys, time, numpy, symforce
symforce.set_symbolic_api('symengine')
symforce.set_epsilon_to_zero()
import symforce.symbolic as sf
from symforce import codegen
from symforce.values import Values
n = int(sys.argv[1]); q = numpy.load(sys.argv[2])[:n].copy(); p = numpy.load(sys.argv[3])
def turn(k, a):
    c, s = sf.cos(a), sf.sin(a)
    return sf.M33(([[1, 0, 0], [0, c, -s], [0, s, c]], [[c, 0, s], [0, 1, 0], [-s, 0, c]], [[c, -s, 0], [s, c, 0], [0, 0, 1]])[k])
def pose(e, linear, k, sign, q):
    r, t = turn(0, 1e-6 * e[3]) * turn(1, 1e-6 * e[4]) * turn(2, 1e-6 * e[5]), sf.V3(*(1e-3 * e[j] for j in range(3)))
    if linear:
        t[k] = t[k] + sign * q
    return (r, t) if linear else (r * turn(k, sign * q), t)
Q, P = (sf.Matrix([[sf.Symbol(name + str(i))] for i in range(size)]) for name, size in (('q', 5), ('p', 30)))
axes = (1, 1, -1), (1, 0, -1), (0, 1, -1), (0, 2, -1), (1, 2, 1)
*workpiece, (r, t) = [pose(P[6 * i : 6 * i + 6], *axis, Q[i]) for i, axis in enumerate(axes)]
d = r * sf.V3(0, 0, -150) + t
for r, t in workpiece:
    d = r.T * (d - t)
made = codegen.Codegen(Values(q=Q, p=P), Values(d=d, j=d.jacobian(P)), codegen.CppConfig(), name='point')
place = made.generate_function(output_dir='symforce', skip_directory_nesting=True).output_dir
open('symforce.cc', 'w').write('''
#include "point.h"
template <int rows, int columns> using M = Eigen::Matrix<double, rows, columns>;
extern "C" void loop(size_t n, const double *q, const double *p, double *d, double *j) {
    const M<30, 1> P = Eigen::Map<const M<30, 1>>(p);
    for (size_t i = 0; i < n; ++i) {
        M<3, 1> D; M<3, 30> J;
        sym::Point<double>(Eigen::Map<const M<5, 1>>(q + 5 * i), P, &D, &J);
        Eigen::Map<M<3, 1>>(d + 3 * i) = D; Eigen::Map<M<3, 30>>(j + 90 * i) = J;
    }
}''')
built = ['g++', '-O3', '-w', '-march=' + sys.argv[5], '-shared', '-fPIC', '-I', str(place), '-isystem', sys.argv[6]]
subprocess.run([*built, 'symforce.cc', '-o', 'symforce.so'], check=True)
loop = ctypes.CDLL('./symforce.so').loop; d = numpy.empty((n, 3)); j = numpy.empty((n, 90)); best = 1e9
for _ in range(5):
    s = time.process_time(); loop(ctypes.c_size_t(n), *(ctypes.c_void_p(x.ctypes.data) for x in (q, p, d, j)))
    best = min(best, time.process_time() - s)
numpy.save(sys.argv[4], j[:50].reshape(50, 30, 3).transpose(0, 2, 1)); print(best / n)
"""
