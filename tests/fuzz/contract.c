/*
 * The contract of the generated functions under hostile arguments, and the commands along paths through singular poses.
 *
 *     contract calls COUNT SEED                  fuzzed calls: nothing that is not finite with SF_OK or SF_SINGULAR; q untouched
 *                                                after anything else; what SF_OK promises holds
 *     contract paths COUNT SEED KINDS POSE ...   straight paths of wanted poses through and past the rotary positions POSE (rad,
 *                                                one for every rotary axis, comma by comma; KINDS: r or l for every axis); largest step over the wanted one
 *
 * Prints what fails, ends with 1 then.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "sf.h"

static uint64_t state;
static long failures = 0;

static uint64_t bits(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state * 2685821657736338717ULL;
}

static double uniform(double low, double high)
{
    return low + (high - low) * ((double)(bits() >> 11) / 9007199254740992.0);
}

static sf_real odd(double usual)
{
    static const double values[] = { NAN, INFINITY, -INFINITY, 0.0, -0.0, 1e300, -1e300, 1e-310, 1e5, -1e5, 1.0000001e5, 1e30, 3e38, 1e20 };
    const uint64_t choice = bits() % 64;
    union { uint64_t u; double d; } any;

    if (choice < sizeof(values) / sizeof(values[0])) {
        return (sf_real)values[choice];
    }
    if (choice < 20) {
        any.u = bits();
        return (sf_real)any.d;
    }
    if (choice < 24) {
        return (sf_real)(usual * pow(10.0, uniform(-12.0, 12.0)));
    }
    return (sf_real)uniform(-usual, usual);
}

/* Mostly usual values, so that most calls come as far as the iterations. */
static void fill(sf_real *x, int count, double usual)
{
    const int hostile = bits() % 8 == 0;

    for (int i = 0; i < count; ++i) {
        x[i] = hostile ? odd(usual) : (sf_real)uniform(-usual, usual);
    }
}

static int finite_all(const sf_real *x, int count)
{
    for (int i = 0; i < count; ++i) {
        if (!isfinite(x[i])) {
            return 0;
        }
    }
    return 1;
}

static void fail(const char *function, int status, const char *what)
{
    if (++failures <= 20) {
        printf("%s, status %d: %s\n", function, status, what);
    }
}

static void results(const char *function, int status, const sf_real *x, int count)
{
    if ((status == SF_OK || status == SF_SINGULAR) && !finite_all(x, count)) {
        fail(function, status, "a result is not finite");
    }
    if (status != SF_OK && status != SF_INVALID) {
        fail(function, status, "a status that it does not have");
    }
}

#ifdef SF_ITERATIONS
static void solution(const char *function, int status, const sf_real *q, const sf_real *before)
{
    if (status == SF_OK || status == SF_SINGULAR) {
        if (!finite_all(q, SF_AXES)) {
            fail(function, status, "a command is not finite");
        }
        for (int i = 0; i < SF_AXES; ++i) {
            if (fabs((double)q[i]) > 2.0 * SF_FARTHEST) {
                fail(function, status, "a command is out of bounds");
            }
        }
    } else if (memcmp(q, before, SF_AXES * sizeof(sf_real)) != 0) {
        fail(function, status, "q was changed");
    }
}
#endif

static double size_of(const sf_real *x, int count)
{
    double most = 0.0;

    for (int i = 0; i < count; ++i) {
        most = fmax(most, fabs((double)x[i]));
    }
    return most;
}

static void near_to(const char *function, int status, const sf_real *a, const sf_real *b, double limit)
{
    for (int i = 0; i < 3; ++i) {
        if (!(fabs((double)a[i] - (double)b[i]) <= limit)) {
            fail(function, status, "not where it says");
            break;
        }
    }
}

static void calls(long count, const sf_real *identified)
{
    long told[5] = { 0 };

    for (long n = 0; n < count; ++n) {
        sf_real q[SF_AXES], tool[3], p[SF_P_SIZE], target[3], before[SF_AXES];
        sf_real point[3], direction[3], other[3], third[3], by_q[3 * SF_AXES], slopes[3 * SF_AXES];
        const double factor = uniform(-3.0, 3.0);
        int status = SF_OK, sane;

        fill(q, SF_AXES, bits() % 2 ? 3.0 : 300.0);
        fill(tool, 3, 200.0);
        fill(target, 3, 300.0);
        for (int i = 0; i < SF_P_SIZE; ++i) {
            p[i] = (sf_real)(factor * (double)identified[i]);
        }
        if (bits() % 16 == 0) {
            fill(p, SF_P_SIZE, 100.0);
        }
        if (bits() % 8 == 0) { /* at and about a pole of many machines */
            for (int i = 0; i < SF_AXES; ++i) {
                q[i] = (sf_real)(bits() % 2 ? 0.0 : uniform(-1.0, 1.0) * pow(10.0, uniform(-9.0, 0.0)));
            }
        }
        sane = size_of(q, SF_AXES) < 1e4 && size_of(tool, 3) < 1e4 && size_of(target, 3) < 1e4 && size_of(p, SF_P_SIZE) < 1e3;
        sane = sane && sf_error(q, tool, p, point, direction) == SF_OK && size_of(point, 3) < 100.0; /* rounding grows with errors */
        memcpy(before, q, sizeof(q));
        switch (bits() % 10) {
        case 0:
            status = sf_forward(q, tool, p, point, direction);
            results("forward", status, point, 3);
            results("forward", status, direction, 3);
            break;
        case 1:
            status = sf_nominal(q, tool, point, direction);
            results("nominal", status, point, 3);
            results("nominal", status, direction, 3);
            break;
        case 2:
            status = sf_error(q, tool, p, point, direction);
            results("error", status, point, 3);
            results("error", status, direction, 3);
            break;
        case 3:
            status = sf_axis_jacobian(q, tool, p, by_q, slopes);
            results("axis_jacobian", status, by_q, 3 * SF_AXES);
            results("axis_jacobian", status, slopes, 3 * SF_AXES);
            break;
#if SF_PARAMETERS > 0
        case 4: {
            sf_real by_p[3 * SF_PARAMETERS];

            status = sf_parameter_jacobian(q, tool, p, by_p);
            results("parameter_jacobian", status, by_p, 3 * SF_PARAMETERS);
            break;
        }
#endif
#ifdef SF_ITERATIONS
        case 5:
            status = sf_inverse_nominal(target, tool, q);
            solution("inverse_nominal", status, q, before);
            if (status == SF_OK && sane) {
                near_to("inverse_nominal", sf_nominal(q, tool, point, direction), point, target, 1e6 * SF_TOLERANCE);
            }
            break;
        case 6:
            status = sf_inverse(target, tool, p, q);
            solution("inverse", status, q, before);
            if (status == SF_OK && sane) {
                near_to("inverse", sf_forward(q, tool, p, point, direction), point, target, 1e2 * SF_TOLERANCE);
            }
            break;
        case 7:
            status = sf_compensate(before, tool, p, q);
            solution("compensate", status, q, before);
            if (status == SF_OK && sane) {
                (void)sf_nominal(before, tool, other, third);
                near_to("compensate", sf_forward(q, tool, p, point, direction), point, other, 1e2 * SF_TOLERANCE);
            }
            break;
#ifdef SF_UNIT_TOLERANCE
        case 8: {
            const double length = uniform(0.998, 1.002);

            if (bits() % 4 != 0) { /* of about unit length, some of them about an axis */
                double size = 0.0;

                for (int i = 0; i < 3; ++i) {
                    target[i] = (sf_real)(bits() % 4 == 0 ? 0.0 : uniform(-1.0, 1.0) * pow(10.0, bits() % 2 ? 0.0 : uniform(-9.0, 0.0)));
                    size += (double)target[i] * (double)target[i];
                }
                for (int i = 0; i < 3; ++i) {
                    target[i] = (sf_real)((double)target[i] / sqrt(size) * length);
                }
            }
            status = sf_orient(target, q);
            solution("orient", status, q, before);
            if ((status == SF_OK || status == SF_SINGULAR) && sane) {
                const double size = sqrt((double)target[0] * target[0] + (double)target[1] * target[1] + (double)target[2] * target[2]);

                if (fabs(size - 1.0) > 1.001 * SF_UNIT_TOLERANCE) {
                    fail("orient", status, "no unit vector");
                }
                for (int i = 0; i < 3; ++i) {
                    target[i] = (sf_real)((double)target[i] / size);
                }
                (void)sf_nominal(q, tool, point, direction);
                near_to("orient", status, direction, target, sizeof(sf_real) == 8 ? 3e-6 : 5e-3);
            }
            break;
        }
        case 9:
            status = sf_compensate_direction(before, tool, p, q);
            solution("compensate_direction", status, q, before);
            if ((status == SF_OK || status == SF_SINGULAR) && sane) {
                (void)sf_nominal(before, tool, other, third);
                (void)sf_forward(q, tool, p, point, direction);
                near_to("compensate_direction", status, point, other, 1e2 * SF_TOLERANCE);
                if (status == SF_OK) {
                    near_to("compensate_direction", status, direction, third, sizeof(sf_real) == 8 ? 1e-10 : 1e-4);
                }
            }
            break;
#endif
#endif
        default:
            break;
        }
        ++told[status];
    }
    printf("%ld calls: %ld done, %ld singular, %ld unreachable, %ld not converged, %ld invalid\n", count, told[0], told[1], told[2],
           told[3], told[4]);
}

#ifdef SF_UNIT_TOLERANCE
#define LEVER 500.0 /* mm: what a turn moves, so that lengths and angles can be added */

static double step_of(const sf_real *a, const sf_real *b, const char *kinds)
{
    double sum = 0.0;

    for (int i = 0; i < SF_AXES; ++i) {
        const double d = ((double)a[i] - (double)b[i]) * (kinds[i] == 'r' ? LEVER : 1.0);
        sum += d * d;
    }
    return sqrt(sum);
}

static void paths(long count, const sf_real *identified, const char *kinds, int poses, char **pose)
{
    double worst = 0.0;
    long steps = 0, singular = 0;

    for (long n = 0; n < count; ++n) {
        const double step = pow(10.0, uniform(-7.0, -2.5)), past = bits() % 2 ? 0.0 : uniform(-0.05, 0.05);
        const double factor = uniform(-2.0, 2.0);
        sf_real wanted[SF_AXES], last_wanted[SF_AXES], q[SF_AXES], last[SF_AXES], p[SF_P_SIZE];
        const sf_real tool[3] = { 0, 0, (sf_real)uniform(-200.0, 0.0) };
        double middle[SF_AXES], way[SF_AXES];
        char *place = pose[bits() % (unsigned long)poses];
        int usable = 0;
        /* to wherever the singular region begins: half the paths in its middle, half over its edge */
        const double from = bits() % 2 ? -100.5 * step : uniform(-0.1, 0.1);

        for (int i = 0; i < SF_P_SIZE; ++i) {
            p[i] = (sf_real)(factor * (double)identified[i]);
        }
        for (int i = 0; i < SF_AXES; ++i) {
            middle[i] = kinds[i] == 'r' ? strtod(place, &place) + past : uniform(-200.0, 200.0);
            place += kinds[i] == 'r' && *place == ',';
            way[i] = uniform(-1.0, 1.0) * (kinds[i] == 'r' ? 1.0 : bits() % 2 * LEVER);
        }
        for (int k = 0; k <= 200; ++k) {
            int status;

            for (int i = 0; i < SF_AXES; ++i) {
                wanted[i] = (sf_real)(middle[i] + way[i] * (from + k * step));
            }
            status = sf_compensate_direction(wanted, tool, p, q);
            if (status != SF_OK && status != SF_SINGULAR) {
                fail("compensate_direction", status, "no command on a path");
            } else if (usable) {
                const double ratio = step_of(q, last, kinds) / step_of(wanted, last_wanted, kinds);

                worst = fmax(worst, ratio);
                if (!(ratio <= 10.0)) {
                    fail("compensate_direction", status, "the command jumps");
                }
                ++steps;
                singular += status == SF_SINGULAR;
            }
            usable = status == SF_OK || status == SF_SINGULAR;
            memcpy(last, q, sizeof(q));
            memcpy(last_wanted, wanted, sizeof(wanted));
        }
    }
    printf("%ld paths, %ld steps, %ld of them singular; commands move at most %.2f times as far as wanted\n", count, steps, singular,
           worst);
}
#endif

int main(int count, char **words)
{
    sf_real identified[SF_P_SIZE];

    if (count < 4) {
        return 2;
    }
    state = strtoull(words[3], NULL, 10) * 2654435769ULL + 88172645463325252ULL;
    sf_parameters(identified);
    if (strcmp(words[1], "calls") == 0) {
        calls(atol(words[2]), identified);
#ifdef SF_UNIT_TOLERANCE
    } else if (strcmp(words[1], "paths") == 0 && count > 5) {
        paths(atol(words[2]), identified, words[4], count - 5, words + 5);
#endif
    } else {
        return 2;
    }
    printf("%ld failures\n", failures);
    return failures != 0;
}
