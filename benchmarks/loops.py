"""C of `codegen.py`: the limits of the computer, and tight loops around generated functions."""

from __future__ import annotations

LIMITS = """
#include <stddef.h>
#include "sf_batch.h"
typedef double v __attribute__((vector_size(8 * SF_LANES)));
enum { LINE = 64 / sizeof(v) };
static v numbers(void) /* lines of zeros are written faster by some processors */
{
    v x;
    for (int i = 0; i < SF_LANES; ++i) {
        x[i] = 1.5 + i;
    }
    return x;
}
void write_limit(v *p, size_t n)
{
    const v x = numbers();
    for (size_t i = 0; i + LINE <= n; i += LINE) {
        for (int k = 0; k < LINE; ++k) {
#if defined(__clang__)
            __builtin_nontemporal_store(x, p + i + k);
#elif defined(__AVX__)
            __asm__("vmovntpd %1, %0" : "=m"(p[i + k]) : "v"(x));
#elif defined(__SSE2__)
            __asm__("movntpd %1, %0" : "=m"(p[i + k]) : "x"(x));
#else
            p[i + k] = x;
#endif
        }
    }
}
void fetched_write_limit(v *p, size_t n)
{
    const v x = numbers();
    for (size_t i = 0; i + LINE <= n; i += LINE) {
        for (int k = 0; k < LINE; ++k) {
            p[i + k] = x;
        }
        __builtin_prefetch(p + i + 90 * LINE, 1, 3);
    }
}
double multiply_add_limit(size_t n)
{
    const v x = { 1.0000001 }, y = { 1e-9 };
    v a = x, b = x * 2, c = x * 3, d = x * 4, e = x * 5, f = x * 6, g = x * 7, h = x * 8, i = x * 9, j = x * 10;
    for (size_t k = 0; k < n; ++k) {
        a = a * x + y; b = b * x + y; c = c * x + y; d = d * x + y; e = e * x + y;
        f = f * x + y; g = g * x + y; h = h * x + y; i = i * x + y; j = j * x + y;
    }
    return (a + b + c + d + e + f + g + h + i + j)[0];
}
"""
LOOPS = """
#include <stddef.h>
#include "sf.h"
#include "casadi.c"
void casadi_all(size_t n, const double *q, const double *tool, const double *p, double *position, double *by_p)
{
    double w[20000];
    long long iw[8];
    for (size_t i = 0; i < n; ++i) {
        const double *arg[3] = { q + 5 * i, tool, p };
        double *res[2] = { position + 3 * i, by_p + 90 * i };
        jacobian(arg, res, iw, w, 0);
    }
}
void casadi_forward(size_t n, const double *q, const double *tool, const double *p, double *position, double *unused)
{
    double w[20000];
    long long iw[8];
    (void)unused;
    for (size_t i = 0; i < n; ++i) {
        const double *arg[3] = { q + 5 * i, tool, p };
        double *res[1] = { position + 3 * i };
        point(arg, res, iw, w, 0);
    }
}
void ours_all(size_t n, const double *q, const double *tool, const double *p, double *position, double *by_p)
{
    for (size_t i = 0; i < n; ++i) {
        sf_parameter_jacobian(q + 5 * i, tool, p, by_p + 90 * i);
    }
    (void)position;
}
void ours_forward(size_t n, const double *q, const double *tool, const double *p, double *position, double *direction)
{
    for (size_t i = 0; i < n; ++i) {
        sf_forward(q + 5 * i, tool, p, position + 3 * i, direction);
    }
}
void ours_inverse(size_t n, const double *q, const double *tool, const double *p, double *position, double *unused)
{
    (void)unused;
    for (size_t i = 0; i < n; ++i) {
        double back[5] = { 0, 0, q[5 * i + 2], q[5 * i + 3], 0 };
        const double target[3] = { 10, 20, 30 };
        position[3 * i] = sf_inverse(target, tool, p, back) + back[0];
    }
}
"""
