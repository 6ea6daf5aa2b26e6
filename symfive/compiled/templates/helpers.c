#define UNUSED __attribute__((unused))
#define INLINED static inline __attribute__((always_inline, unused))

typedef double v __attribute__((vector_size(LANES * 8), may_alias));
typedef long long w __attribute__((vector_size(LANES * 8), may_alias));

INLINED v where(w condition, v yes, v no)
{
    return (v)((condition & (w)yes) | (~condition & (w)no));
}

INLINED v flag(w condition)
{
    const v zero = { 0.0 };
    return where(condition, zero + 1.0, zero);
}

INLINED v lanes(double (*function)(double), v x)
{
    v y;
    for (int i = 0; i < LANES; ++i) {
        y[i] = function(x[i]);
    }
    return y;
}

INLINED v lane_pairs(double (*function)(double, double), v a, v b)
{
    v y;
    for (int i = 0; i < LANES; ++i) {
        y[i] = function(a[i], b[i]);
    }
    return y;
}
