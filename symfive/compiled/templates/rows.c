/* A function over rows, as many at a time as a vector holds. Made by symfive for itself; never with -ffast-math. */
#include <math.h>
#include <stddef.h>

/* 0 and 1 keep it; 16 says that half precision has operations of its own (AVX512-FP16) */
#if defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ != 0 && __FLT_EVAL_METHOD__ != 1 && __FLT_EVAL_METHOD__ != 16
#error "double precision is not kept"
#endif

$lanes
#define fmin(a, b) ((((a) <= (b)) || ((b) != (b))) ? (a) : (b)) /* of two zeros the first, as CasADi */
#define fmax(a, b) ((((a) >= (b)) || ((b) != (b))) ? (a) : (b))
$helpers

/* Rows into vectors; lanes that are not used repeat the last row. */
static void gather(const double *from, size_t size, size_t row, size_t used, v *x)
{
    for (size_t lane = 0; lane < LANES; ++lane) {
        const double *const source = from + ((row + (lane < used ? lane : used - 1U)) * size);

        for (size_t i = 0; i < size; ++i) {
            x[i][lane] = source[i];
        }
    }
}

static void scatter(const v *y, size_t size, double *to, size_t used)
{
    for (size_t lane = 0; lane < used; ++lane) {
        for (size_t i = 0; i < size; ++i) {
            to[(lane * size) + i] = y[i][lane];
        }
    }
}

static void one_vector(const v *restrict x UNUSED, const double *restrict c UNUSED, v *restrict y UNUSED)
{
    const v zero UNUSED = { 0.0 };
$offsets
$body
}

/* Bytes that a call works in. */
size_t symfive_work(void)
{
    return (sizeof(v) * (${inputs}U + ${outputs}U)) + (sizeof(double) * ${constants}U);
}

void symfive_rows(size_t rows, const double *const *given UNUSED, double *const *results UNUSED, double *work)
{
    const v zero UNUSED = { 0.0 };
    v *const x = (v *)work;
    v *const y = x + ${inputs}U;
    double *const c = (double *)(y + ${outputs}U);
$load
$prepare
$fixed

    for (size_t row = 0; row < rows; row += LANES) {
        const size_t used = (rows - row < LANES) ? rows - row : LANES;

$gather
        one_vector(x, c, y);
$scatter
    }
}
