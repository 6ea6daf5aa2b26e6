/*
 * sf_batch.c: see sf_batch.h. Made by symfive 0.1.0; change the model, not this file.
 * model sha256 74a1813ac4abe34ed5aac8b3a152445812b6762ed1acfd3276113623cfb8024c
 */
#include <math.h>
#include "sf_batch.h"

#if defined(__AVX512F__)
#define LANES 8
#elif defined(__AVX2__)
#define LANES 4
#elif defined(__SSE2__) || defined(__aarch64__) || defined(__VSX__)
#define LANES 2
#else
#define LANES 1
#endif
#if SF_LANES > LANES
#error "SF_LANES: this instruction set has no registers of so many doubles"
#endif
#undef LANES
#define LANES SF_LANES
#define COLUMNS 12U
#define CHUNK 16U
#define ROWS (3U * CHUNK)
#define LINE_BYTES 64U /* of a cache */
#define FETCHED_BYTES 1000000U /* results larger than this are not in the caches: their lines are fetched before they are written */
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

/*
 * Sine and cosine to about 1e-16 for |x| <= 1e5: reduction by pi/2 in three parts (Cody and Waite), then the polynomials of
 * fdlibm's kernel functions on +-pi/4 (Sun Microsystems 1993), and the quadrant's exchange and signs by bit operations.
 */
INLINED void sine_cosine(v x, v *sine, v *cosine)
{
    const double shift = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to a whole number in the low bits */
    const v shifted = (x * 0.63661977236758134308) + shift;
    const v turns = shifted - shift;
    const w quadrant = (w)shifted;
    const v r = ((x - (turns * 1.57079632673412561417e+00)) - (turns * 6.07710050630396597660e-11))
                - (turns * 2.02226624879595063154e-21);
    const v z = r * r;
    const v s = r + ((r * z) * (-1.66666666666666324348e-01 + (z * (8.33333333332248946124e-03
                + (z * (-1.98412698298579493134e-04 + (z * (2.75573137070700676789e-06
                + (z * (-2.50507602534068634195e-08 + (z * 1.58969099521155010221e-10)))))))))));
    const v c = (1.0 - (0.5 * z)) + ((z * z) * (4.16666666666666019037e-02 + (z * (-1.38888888888741095749e-03
                + (z * (2.48015872894767294178e-05 + (z * (-2.75573143513906633035e-07
                + (z * (2.08757232129817482790e-09 + (z * -1.13596475577881948265e-11)))))))))));
    const w odd = -(quadrant & 1);

    *sine = (v)((w)where(odd, c, s) ^ ((quadrant & 2) << 62));
    *cosine = (v)((w)where(odd, s, c) ^ (((quadrant + 1) & 2) << 62));
}

/*
 * Writes a vector past the caches, as far as the processor has an instruction for that. GCC's own function for it is not used:
 * hundreds of them in one function take its instruction combiner most of the time it needs to compile.
 */
INLINED void store_past_caches(v *place, v value)
{
#if defined(__clang__)
    __builtin_nontemporal_store(value, place);
#elif defined(__AVX__) && (SF_LANES > 1)
    __asm__("vmovntpd %1, %0" : "=m"(*place) : "v"(value));
#elif defined(__SSE2__) && (SF_LANES > 1)
    __asm__("movntpd %1, %0" : "=m"(*place) : "x"(value));
#else
    *place = value;
#endif
}

INLINED void finish_stores(void)
{
#if defined(__SSE__)
    __builtin_ia32_sfence();
#endif
}

size_t sf_batch_lanes(void)
{
    return LANES;
}

const char *sf_batch_model(void)
{
    return "74a1813ac4abe34ed5aac8b3a152445812b6762ed1acfd3276113623cfb8024c";
}

void sf_batch_prepare(const double *tool, const double *p, double *c)
{
    const double p0 = p[0];
    const double p1 = p[1];
    const double p2 = p[2];
    const double p3 = p[3];
    const double p4 = p[4];
    const double p5 = p[5];
    const double p6 = p[6];
    const double p7 = p[7];
    const double p8 = p[8];
    const double tool0 = tool[0];
    const double tool1 = tool[1];
    const double tool2 = tool[2];
    const double k0 = (double)(1e-06);
    const double k1 = (double)(0.001);
    const double t0 = k0 * p4;
    const double t1 = sin(t0);
    c[0] = t1;
    c[1] = tool0;
    const double t2 = k0 * p2;
    const double t3 = sin(t2);
    c[2] = t3;
    c[3] = cos(t0);
    const double t4 = cos(t2);
    c[4] = t4;
    c[5] = tool1;
    c[6] = tool2;
    const double t5 = k0 * p0;
    c[7] = cos(t5);
    c[8] = sin(t5);
    c[9] = k1 * p3;
    c[10] = k1 * p5;
    c[11] = k1 * p6;
    c[12] = k1 * p7;
    c[13] = k1 * p8;
    c[14] = k1 * p1;
    c[15] = t1 * t4;
    c[16] = t1 * t3;
}

INLINED void point_tile(const v *restrict q, const double *restrict c, v *restrict position)
{
    const v zero UNUSED = { 0.0 };
    v s0, c0;
    sine_cosine(q[3], &s0, &c0);
    v s2, c2;
    sine_cosine(q[2], &s2, &c2);
    const v t12 = c[0] * s0;
    const v t18 = (c0 * c2) + (t12 * s2);
    const v t24 = s2 * c[2];
    const v t27 = -(c0 * t24);
    const v t29 = s0 * c[3];
    const v t35 = c2 * c[2];
    const v t38 = (t27 - (t29 * c[4])) + (t12 * t35);
    const v t43 = -(c[2] * t29);
    const v t44 = s2 * c[4];
    const v t49 = c2 * c[4];
    const v t52 = (t43 + (c0 * t44)) - (t12 * t49);
    const v t62 = c[7] * q[1];
    const v t65 = q[1] * c[8];
    const v t87 = ((c0 * c[10]) + (s0 * c[11])) + (c[12] * ((c0 * c0) - (s0 * s0)));
    const v t84 = c0 * s0;
    const v t92 = c[9] + (t87 + ((t84 + t84) * c[13]));
    const v t101 = (((t18 * t62) + (t38 * t65)) - ((c0 * t92) + (t18 * c[14]))) + (t38 * q[0]);
    const v t103 = (((t18 * c[1]) + (t38 * c[5])) + (t52 * c[6])) + ((t52 * q[4]) + t101);
    position[0] = t103;
    const v t104 = c0 * c[0];
    const v t106 = -(s2 * t104);
    const v t109 = t106 + (c2 * s0);
    const v t111 = c0 * c[3];
    const v t116 = ((c[4] * t111) - (s0 * t24)) - (t35 * t104);
    const v t123 = ((s0 * t44) + (c[2] * t111)) + (t49 * t104);
    const v t128 = -(s0 * t92);
    const v t136 = ((t128 - (c[14] * t109)) + ((t62 * t109) + (t65 * t116))) + (q[0] * t116);
    const v t138 = (((c[1] * t109) + (c[5] * t116)) + (c[6] * t123)) + ((q[4] * t123) + t136);
    position[1] = t138;
    const v t139 = s2 * c[3];
    const v t142 = -(c[1] * t139);
    const v t145 = c[15] + (c[3] * t35);
    const v t150 = (c[3] * t49) - c[16];
    const v t162 = (((t65 * t145) + (t62 * t139)) - (c[14] * t139)) + (q[0] * t145);
    const v t164 = ((t142 - (c[5] * t145)) + (c[6] * t150)) + ((q[4] * t150) - t162);
    position[2] = t164;
}

/* The Jacobian of one tile, written past the caches. */
#define PUT(k, i, value) store_past_caches(by_p + (3U * (k)) + (i), (value))
INLINED void jacobian_past_caches(const v *restrict q, const double *restrict c, v *restrict position, v *restrict by_p)
{
    const v zero UNUSED = { 0.0 };
    (void)by_p;
    v s0, c0;
    sine_cosine(q[3], &s0, &c0);
    v s2, c2;
    sine_cosine(q[2], &s2, &c2);
    const v t12 = c[0] * s0;
    const v t18 = (c0 * c2) + (t12 * s2);
    const v t24 = s2 * c[2];
    const v t27 = -(c0 * t24);
    const v t29 = s0 * c[3];
    const v t35 = c2 * c[2];
    const v t38 = (t27 - (t29 * c[4])) + (t12 * t35);
    const v t43 = -(c[2] * t29);
    const v t44 = s2 * c[4];
    const v t49 = c2 * c[4];
    const v t52 = (t43 + (c0 * t44)) - (t12 * t49);
    const v t62 = c[7] * q[1];
    const v t65 = q[1] * c[8];
    const v t83 = (c0 * c0) - (s0 * s0);
    const v t84 = c0 * s0;
    const v t85 = t84 + t84;
    const v t91 = (((c0 * c[10]) + (s0 * c[11])) + (c[12] * t83)) + (t85 * c[13]);
    const v t92 = c[9] + t91;
    const v t93 = c0 * t92;
    const v t101 = (((t18 * t62) + (t38 * t65)) - (t93 + (t18 * c[14]))) + (t38 * q[0]);
    const v t103 = (((t18 * c[1]) + (t38 * c[5])) + (t52 * c[6])) + ((t52 * q[4]) + t101);
    position[0] = t103;
    const v t104 = c0 * c[0];
    const v t106 = -(s2 * t104);
    const v t109 = t106 + (c2 * s0);
    const v t111 = c0 * c[3];
    const v t116 = ((c[4] * t111) - (s0 * t24)) - (t35 * t104);
    const v t123 = ((s0 * t44) + (c[2] * t111)) + (t49 * t104);
    const v t127 = s0 * t92;
    const v t128 = -t127;
    const v t136 = ((t128 - (c[14] * t109)) + ((t62 * t109) + (t65 * t116))) + (q[0] * t116);
    const v t138 = (((c[1] * t109) + (c[5] * t116)) + (c[6] * t123)) + ((q[4] * t123) + t136);
    position[1] = t138;
    const v t139 = s2 * c[3];
    const v t142 = -(c[1] * t139);
    const v t145 = c[15] + (c[3] * t35);
    const v t150 = (c[3] * t49) - c[16];
    const v t162 = (((t65 * t145) + (t62 * t139)) - (c[14] * t139)) + (q[0] * t145);
    const v t164 = ((t142 - (c[5] * t145)) + (c[6] * t150)) + ((q[4] * t150) - t162);
    position[2] = t164;
    const v t287 = -(1e-06 * ((t18 * t65) - (t38 * t62)));
    PUT(0U, 0U, t287);
    const v t292 = -(1e-06 * ((t65 * t109) - (t62 * t116)));
    PUT(0U, 1U, t292);
    const v t298 = -(1e-06 * ((t62 * t145) - (t65 * t139)));
    PUT(0U, 2U, t298);
    const v t300 = -(t18 * 0.001);
    PUT(1U, 0U, t300);
    const v t302 = -(0.001 * t109);
    PUT(1U, 1U, t302);
    const v t303 = 0.001 * t139;
    PUT(1U, 2U, t303);
    const v t223 = t138 + t127;
    const v t310 = -(1e-06 * ((t109 * t164) + (t139 * t223)));
    PUT(2U, 0U, t310);
    const v t226 = t93 + t103;
    const v t312 = -(t139 * t226);
    const v t316 = -(1e-06 * (t312 - (t18 * t164)));
    PUT(2U, 1U, t316);
    const v t321 = -(1e-06 * ((t18 * t223) - (t109 * t226)));
    PUT(2U, 2U, t321);
    const v t322 = c0 * 0.001;
    const v t323 = -t322;
    PUT(3U, 0U, t323);
    const v t324 = s0 * 0.001;
    const v t325 = -t324;
    PUT(3U, 1U, t325);
    PUT(3U, 2U, (0.0 - zero));
    PUT(5U, 2U, (0.0 - zero));
    PUT(6U, 2U, (0.0 - zero));
    PUT(7U, 2U, (0.0 - zero));
    PUT(8U, 2U, (0.0 - zero));
    const v t329 = -(1e-06 * (s0 * t164));
    PUT(4U, 0U, t329);
    const v t331 = 1e-06 * (c0 * t164);
    PUT(4U, 1U, t331);
    const v t337 = -(1e-06 * ((c0 * t138) - (s0 * t103)));
    PUT(4U, 2U, t337);
    const v t339 = -(c0 * t322);
    PUT(5U, 0U, t339);
    const v t341 = -(s0 * t322);
    PUT(5U, 1U, t341);
    const v t343 = -(c0 * t324);
    PUT(6U, 0U, t343);
    const v t345 = -(s0 * t324);
    PUT(6U, 1U, t345);
    const v t346 = 0.001 * t83;
    const v t348 = -(c0 * t346);
    PUT(7U, 0U, t348);
    const v t350 = -(s0 * t346);
    PUT(7U, 1U, t350);
    const v t351 = 0.001 * t85;
    const v t353 = -(c0 * t351);
    PUT(8U, 0U, t353);
    const v t355 = -(s0 * t351);
    PUT(8U, 1U, t355);
}
#undef PUT

/* The same, kept in the caches; column k stands at by_p + k * stride. */
#define PUT(k, i, value) by_p[((k) * stride) + (i)] = (value)
static __attribute__((noinline)) void jacobian_kept(const v *restrict q, const double *restrict c, v *restrict position,
                                                    v *restrict by_p, const size_t stride)
{
    const v zero UNUSED = { 0.0 };
    (void)by_p;
    (void)stride;
    v s0, c0;
    sine_cosine(q[3], &s0, &c0);
    v s2, c2;
    sine_cosine(q[2], &s2, &c2);
    const v t12 = c[0] * s0;
    const v t18 = (c0 * c2) + (t12 * s2);
    const v t24 = s2 * c[2];
    const v t27 = -(c0 * t24);
    const v t29 = s0 * c[3];
    const v t35 = c2 * c[2];
    const v t38 = (t27 - (t29 * c[4])) + (t12 * t35);
    const v t43 = -(c[2] * t29);
    const v t44 = s2 * c[4];
    const v t49 = c2 * c[4];
    const v t52 = (t43 + (c0 * t44)) - (t12 * t49);
    const v t62 = c[7] * q[1];
    const v t65 = q[1] * c[8];
    const v t83 = (c0 * c0) - (s0 * s0);
    const v t84 = c0 * s0;
    const v t85 = t84 + t84;
    const v t91 = (((c0 * c[10]) + (s0 * c[11])) + (c[12] * t83)) + (t85 * c[13]);
    const v t92 = c[9] + t91;
    const v t93 = c0 * t92;
    const v t101 = (((t18 * t62) + (t38 * t65)) - (t93 + (t18 * c[14]))) + (t38 * q[0]);
    const v t103 = (((t18 * c[1]) + (t38 * c[5])) + (t52 * c[6])) + ((t52 * q[4]) + t101);
    position[0] = t103;
    const v t104 = c0 * c[0];
    const v t106 = -(s2 * t104);
    const v t109 = t106 + (c2 * s0);
    const v t111 = c0 * c[3];
    const v t116 = ((c[4] * t111) - (s0 * t24)) - (t35 * t104);
    const v t123 = ((s0 * t44) + (c[2] * t111)) + (t49 * t104);
    const v t127 = s0 * t92;
    const v t128 = -t127;
    const v t136 = ((t128 - (c[14] * t109)) + ((t62 * t109) + (t65 * t116))) + (q[0] * t116);
    const v t138 = (((c[1] * t109) + (c[5] * t116)) + (c[6] * t123)) + ((q[4] * t123) + t136);
    position[1] = t138;
    const v t139 = s2 * c[3];
    const v t142 = -(c[1] * t139);
    const v t145 = c[15] + (c[3] * t35);
    const v t150 = (c[3] * t49) - c[16];
    const v t162 = (((t65 * t145) + (t62 * t139)) - (c[14] * t139)) + (q[0] * t145);
    const v t164 = ((t142 - (c[5] * t145)) + (c[6] * t150)) + ((q[4] * t150) - t162);
    position[2] = t164;
    const v t287 = -(1e-06 * ((t18 * t65) - (t38 * t62)));
    PUT(0U, 0U, t287);
    const v t292 = -(1e-06 * ((t65 * t109) - (t62 * t116)));
    PUT(0U, 1U, t292);
    const v t298 = -(1e-06 * ((t62 * t145) - (t65 * t139)));
    PUT(0U, 2U, t298);
    const v t300 = -(t18 * 0.001);
    PUT(1U, 0U, t300);
    const v t302 = -(0.001 * t109);
    PUT(1U, 1U, t302);
    const v t303 = 0.001 * t139;
    PUT(1U, 2U, t303);
    const v t223 = t138 + t127;
    const v t310 = -(1e-06 * ((t109 * t164) + (t139 * t223)));
    PUT(2U, 0U, t310);
    const v t226 = t93 + t103;
    const v t312 = -(t139 * t226);
    const v t316 = -(1e-06 * (t312 - (t18 * t164)));
    PUT(2U, 1U, t316);
    const v t321 = -(1e-06 * ((t18 * t223) - (t109 * t226)));
    PUT(2U, 2U, t321);
    const v t322 = c0 * 0.001;
    const v t323 = -t322;
    PUT(3U, 0U, t323);
    const v t324 = s0 * 0.001;
    const v t325 = -t324;
    PUT(3U, 1U, t325);
    PUT(3U, 2U, (0.0 - zero));
    PUT(5U, 2U, (0.0 - zero));
    PUT(6U, 2U, (0.0 - zero));
    PUT(7U, 2U, (0.0 - zero));
    PUT(8U, 2U, (0.0 - zero));
    const v t329 = -(1e-06 * (s0 * t164));
    PUT(4U, 0U, t329);
    const v t331 = 1e-06 * (c0 * t164);
    PUT(4U, 1U, t331);
    const v t337 = -(1e-06 * ((c0 * t138) - (s0 * t103)));
    PUT(4U, 2U, t337);
    const v t339 = -(c0 * t322);
    PUT(5U, 0U, t339);
    const v t341 = -(s0 * t322);
    PUT(5U, 1U, t341);
    const v t343 = -(c0 * t324);
    PUT(6U, 0U, t343);
    const v t345 = -(s0 * t324);
    PUT(6U, 1U, t345);
    const v t346 = 0.001 * t83;
    const v t348 = -(c0 * t346);
    PUT(7U, 0U, t348);
    const v t350 = -(s0 * t346);
    PUT(7U, 1U, t350);
    const v t351 = 0.001 * t85;
    const v t353 = -(c0 * t351);
    PUT(8U, 0U, t353);
    const v t355 = -(s0 * t351);
    PUT(8U, 1U, t355);
}
#undef PUT

/* The same, multiplied by a step as it comes. */
#define PUT(k, i, value) sum[(i)] += d[(k)] * (value)
INLINED void jacobian_times(const v *restrict q, const double *restrict c, const double *restrict d, v *restrict predicted)
{
    const v zero UNUSED = { 0.0 };
    (void)d;
    v position[3];
    v sum[3] = { { 0.0 }, { 0.0 }, { 0.0 } };
    v s0, c0;
    sine_cosine(q[3], &s0, &c0);
    v s2, c2;
    sine_cosine(q[2], &s2, &c2);
    const v t12 = c[0] * s0;
    const v t18 = (c0 * c2) + (t12 * s2);
    const v t24 = s2 * c[2];
    const v t27 = -(c0 * t24);
    const v t29 = s0 * c[3];
    const v t35 = c2 * c[2];
    const v t38 = (t27 - (t29 * c[4])) + (t12 * t35);
    const v t43 = -(c[2] * t29);
    const v t44 = s2 * c[4];
    const v t49 = c2 * c[4];
    const v t52 = (t43 + (c0 * t44)) - (t12 * t49);
    const v t62 = c[7] * q[1];
    const v t65 = q[1] * c[8];
    const v t83 = (c0 * c0) - (s0 * s0);
    const v t84 = c0 * s0;
    const v t85 = t84 + t84;
    const v t91 = (((c0 * c[10]) + (s0 * c[11])) + (c[12] * t83)) + (t85 * c[13]);
    const v t92 = c[9] + t91;
    const v t93 = c0 * t92;
    const v t101 = (((t18 * t62) + (t38 * t65)) - (t93 + (t18 * c[14]))) + (t38 * q[0]);
    const v t103 = (((t18 * c[1]) + (t38 * c[5])) + (t52 * c[6])) + ((t52 * q[4]) + t101);
    position[0] = t103;
    const v t104 = c0 * c[0];
    const v t106 = -(s2 * t104);
    const v t109 = t106 + (c2 * s0);
    const v t111 = c0 * c[3];
    const v t116 = ((c[4] * t111) - (s0 * t24)) - (t35 * t104);
    const v t123 = ((s0 * t44) + (c[2] * t111)) + (t49 * t104);
    const v t127 = s0 * t92;
    const v t128 = -t127;
    const v t136 = ((t128 - (c[14] * t109)) + ((t62 * t109) + (t65 * t116))) + (q[0] * t116);
    const v t138 = (((c[1] * t109) + (c[5] * t116)) + (c[6] * t123)) + ((q[4] * t123) + t136);
    position[1] = t138;
    const v t139 = s2 * c[3];
    const v t142 = -(c[1] * t139);
    const v t145 = c[15] + (c[3] * t35);
    const v t150 = (c[3] * t49) - c[16];
    const v t162 = (((t65 * t145) + (t62 * t139)) - (c[14] * t139)) + (q[0] * t145);
    const v t164 = ((t142 - (c[5] * t145)) + (c[6] * t150)) + ((q[4] * t150) - t162);
    position[2] = t164;
    const v t287 = -(1e-06 * ((t18 * t65) - (t38 * t62)));
    PUT(0U, 0U, t287);
    const v t292 = -(1e-06 * ((t65 * t109) - (t62 * t116)));
    PUT(0U, 1U, t292);
    const v t298 = -(1e-06 * ((t62 * t145) - (t65 * t139)));
    PUT(0U, 2U, t298);
    const v t300 = -(t18 * 0.001);
    PUT(1U, 0U, t300);
    const v t302 = -(0.001 * t109);
    PUT(1U, 1U, t302);
    const v t303 = 0.001 * t139;
    PUT(1U, 2U, t303);
    const v t223 = t138 + t127;
    const v t310 = -(1e-06 * ((t109 * t164) + (t139 * t223)));
    PUT(2U, 0U, t310);
    const v t226 = t93 + t103;
    const v t312 = -(t139 * t226);
    const v t316 = -(1e-06 * (t312 - (t18 * t164)));
    PUT(2U, 1U, t316);
    const v t321 = -(1e-06 * ((t18 * t223) - (t109 * t226)));
    PUT(2U, 2U, t321);
    const v t322 = c0 * 0.001;
    const v t323 = -t322;
    PUT(3U, 0U, t323);
    const v t324 = s0 * 0.001;
    const v t325 = -t324;
    PUT(3U, 1U, t325);
    PUT(3U, 2U, (0.0 - zero));
    PUT(5U, 2U, (0.0 - zero));
    PUT(6U, 2U, (0.0 - zero));
    PUT(7U, 2U, (0.0 - zero));
    PUT(8U, 2U, (0.0 - zero));
    const v t329 = -(1e-06 * (s0 * t164));
    PUT(4U, 0U, t329);
    const v t331 = 1e-06 * (c0 * t164);
    PUT(4U, 1U, t331);
    const v t337 = -(1e-06 * ((c0 * t138) - (s0 * t103)));
    PUT(4U, 2U, t337);
    const v t339 = -(c0 * t322);
    PUT(5U, 0U, t339);
    const v t341 = -(s0 * t322);
    PUT(5U, 1U, t341);
    const v t343 = -(c0 * t324);
    PUT(6U, 0U, t343);
    const v t345 = -(s0 * t324);
    PUT(6U, 1U, t345);
    const v t346 = 0.001 * t83;
    const v t348 = -(c0 * t346);
    PUT(7U, 0U, t348);
    const v t350 = -(s0 * t346);
    PUT(7U, 1U, t350);
    const v t351 = 0.001 * t85;
    const v t353 = -(c0 * t351);
    PUT(8U, 0U, t353);
    const v t355 = -(s0 * t351);
    PUT(8U, 1U, t355);
    predicted[0] = position[0] + sum[0];
    predicted[1] = position[1] + sum[1];
    predicted[2] = position[2] + sum[2];
}
#undef PUT

void sf_batch_forward(size_t tiles, const double *q, const double *c, double *position)
{
    for (size_t i = 0; i < tiles; ++i) {
        point_tile((const v *)q + (i * 5U), c, (v *)position + (i * 3U));
    }
}

void sf_batch_jacobian(size_t tiles, const double *q, const double *c, double *position, double *by_p, int stream)
{
    const v *const from = (const v *)q;
    v *const points = (v *)position;
    v *const slopes = (v *)by_p;

    if (stream != 0) {
        for (size_t i = 0; i < tiles; ++i) {
            jacobian_past_caches(from + (i * 5U), c, points + (i * 3U), slopes + (i * 3U * 9U));
        }
        finish_stores();
    } else {
        const size_t lines = 3U * 9U;
        const size_t fetched = (tiles * lines * sizeof(v) > FETCHED_BYTES) ? lines : 0U;

        for (size_t i = 0; i < tiles; ++i) {
            for (size_t k = 0; k < fetched; k += LINE_BYTES / sizeof(v)) { /* what is about to be written */
                __builtin_prefetch(slopes + (i * lines) + k, 1, 3);
            }
            jacobian_kept(from + (i * 5U), c, points + (i * 3U), slopes + (i * 3U * 9U), 3U);
        }
    }
}

void sf_batch_predict(size_t tiles, const double *q, const double *c, const double *d, double *predicted)
{
    for (size_t i = 0; i < tiles; ++i) {
        jacobian_times((const v *)q + (i * 5U), c, d, (v *)predicted + (i * 3U));
    }
}

/* sum[4 i + j] += a_i' b_j, lane by lane, for four columns a and four columns b. */
static __attribute__((noinline)) void block_products(const v *restrict a, const v *restrict b, size_t rows, v *restrict sum)
{
    const v *restrict a1 = a + ROWS, *restrict a2 = a1 + ROWS, *restrict a3 = a2 + ROWS;
    const v *restrict b1 = b + ROWS, *restrict b2 = b1 + ROWS, *restrict b3 = b2 + ROWS;
    v s00 = sum[0], s01 = sum[1], s02 = sum[2], s03 = sum[3], s10 = sum[4], s11 = sum[5], s12 = sum[6], s13 = sum[7];
    v s20 = sum[8], s21 = sum[9], s22 = sum[10], s23 = sum[11], s30 = sum[12], s31 = sum[13], s32 = sum[14], s33 = sum[15];

    for (size_t k = 0; k < rows; ++k) {
        const v x0 = a[k], x1 = a1[k], x2 = a2[k], x3 = a3[k];
        const v y0 = b[k], y1 = b1[k], y2 = b2[k], y3 = b3[k];

        s00 += x0 * y0; s01 += x0 * y1; s02 += x0 * y2; s03 += x0 * y3;
        s10 += x1 * y0; s11 += x1 * y1; s12 += x1 * y2; s13 += x1 * y3;
        s20 += x2 * y0; s21 += x2 * y1; s22 += x2 * y2; s23 += x2 * y3;
        s30 += x3 * y0; s31 += x3 * y1; s32 += x3 * y2; s33 += x3 * y3;
    }
    sum[0] = s00; sum[1] = s01; sum[2] = s02; sum[3] = s03; sum[4] = s10; sum[5] = s11; sum[6] = s12; sum[7] = s13;
    sum[8] = s20; sum[9] = s21; sum[10] = s22; sum[11] = s23; sum[12] = s30; sum[13] = s31; sum[14] = s32; sum[15] = s33;
}

/* Adds one column of J F to the products of its components: xx, xy, xz, yy, yz, zz. */
INLINED void add_products(v x, v y, v z, v *sum)
{
    sum[0] += x * x; sum[1] += x * y; sum[2] += x * z; sum[3] += y * y; sum[4] += y * z; sum[5] += z * z;
}

/* J F F'J' of one vector of poses, four columns of F at a time. */
static __attribute__((noinline)) void tile_leverage(const v *restrict by_p, const double *restrict factor, const size_t rank,
                                                    v *restrict result)
{
    const v zero = { 0.0 };
    v sum[6] = { zero, zero, zero, zero, zero, zero };
    size_t r = 0;

    for (; r + 4U <= rank; r += 4U) {
        v x0 = zero, x1 = zero, x2 = zero, x3 = zero, y0 = zero, y1 = zero, y2 = zero, y3 = zero;
        v z0 = zero, z1 = zero, z2 = zero, z3 = zero;

        for (size_t k = 0; k != 9U; ++k) {
            const v x = by_p[3U * k], y = by_p[(3U * k) + 1U], z = by_p[(3U * k) + 2U];
            const double *const f = factor + (k * rank) + r;

            x0 += x * f[0]; x1 += x * f[1]; x2 += x * f[2]; x3 += x * f[3];
            y0 += y * f[0]; y1 += y * f[1]; y2 += y * f[2]; y3 += y * f[3];
            z0 += z * f[0]; z1 += z * f[1]; z2 += z * f[2]; z3 += z * f[3];
        }
        add_products(x0, y0, z0, sum);
        add_products(x1, y1, z1, sum);
        add_products(x2, y2, z2, sum);
        add_products(x3, y3, z3, sum);
    }
    for (; r < rank; ++r) {
        v x = zero, y = zero, z = zero;

        for (size_t k = 0; k != 9U; ++k) {
            const double f = factor[(k * rank) + r];

            x += by_p[3U * k] * f; y += by_p[(3U * k) + 1U] * f; z += by_p[(3U * k) + 2U] * f;
        }
        add_products(x, y, z, sum);
    }
    for (size_t i = 0; i < 6U; ++i) {
        result[i] = sum[i];
    }
}

void sf_batch_leverage(size_t tiles, const double *q, const double *c, const double *factor, size_t rank,
                       double *leverage, double *work)
{
    v *const by_p = (v *)work;
    v position[3];

    for (size_t i = 0; i < tiles; ++i) {
        jacobian_kept((const v *)q + (i * 5U), c, position, by_p, 3U);
        tile_leverage(by_p, factor, rank, (v *)leverage + (i * 6U));
    }
}

/* The columns of one vector of poses; lanes from `used` on are set to zero. */
static void columns_of_tile(const v *q, const double *c, const v *target, size_t used, v *columns)
{
    v position[3];

    jacobian_kept(q, c, position, columns, ROWS);
    for (size_t i = 0; i < 3U; ++i) {
        columns[(9U * ROWS) + i] = target[i] - position[i];
    }
    for (size_t k = 0; (used < LANES) && (k <= 9U); ++k) {
        for (size_t i = 0; i < 3U; ++i) {
            for (size_t lane = used; lane < LANES; ++lane) {
                columns[(k * ROWS) + i][lane] = 0.0;
            }
        }
    }
}

/* Adds a block's sums over the lanes to the matrix and to its mirror image. */
static void add_block(const v *sum, size_t a, size_t b, double *normal)
{
    for (size_t i = 0; i < 16U; ++i) {
        const size_t row = (4U * a) + (i / 4U), column = (4U * b) + (i % 4U);
        double total = 0.0;

        for (size_t lane = 0; lane < LANES; ++lane) {
            total += sum[i][lane];
        }
        if ((row < SF_NORMAL) && (column <= row)) {
            normal[(row * SF_NORMAL) + column] += total;
            if (row != column) {
                normal[(column * SF_NORMAL) + row] += total;
            }
        }
    }
}

void sf_batch_information(size_t poses, const double *q, const double *c, const double *target, double *normal,
                          double *work)
{
    const v zero = { 0.0 };
    const size_t tiles = (poses + LANES - 1U) / LANES;
    v *const columns = (v *)work;
    v *const sums = columns + (COLUMNS * ROWS);
    const size_t blocks = COLUMNS / 4U;

    for (size_t i = 0; i < COLUMNS * ROWS; ++i) {
        columns[i] = zero;
    }
    for (size_t i = 0; i < blocks * (blocks + 1U) * 8U; ++i) {
        sums[i] = zero;
    }
    for (size_t first = 0; first < tiles; first += CHUNK) {
        const size_t count = (tiles - first < CHUNK) ? tiles - first : CHUNK;
        v *sum = sums;

        for (size_t i = 0; i < count; ++i) {
            const size_t tile = first + i;
            const size_t left = poses - (tile * LANES);

            columns_of_tile((const v *)q + (tile * 5U), c, (const v *)target + (tile * 3U), (left < LANES) ? left : LANES,
                            columns + (3U * i));
        }
        for (size_t a = 0; a < blocks; ++a) {
            for (size_t b = 0; b <= a; ++b) {
                block_products(columns + (4U * a * ROWS), columns + (4U * b * ROWS), 3U * count, sum);
                sum += 16;
            }
        }
    }
    const v *sum = sums;
    for (size_t a = 0; a < blocks; ++a) {
        for (size_t b = 0; b <= a; ++b) {
            add_block(sum, a, b, normal);
            sum += 16;
        }
    }
}
