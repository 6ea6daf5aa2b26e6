/*
 * ${prefix}_selftest.c: checks $prefix.c on this compiler and processor. Prints what fails; exit code 0 means that all is well.
 * Expected values come from the symbolic model itself, differentiated automatically. Made by symfive $version.
 */
#include <math.h>
#include <stdio.h>
#include "$prefix.h"

#ifdef ${PREFIX}_FLOAT
#define POINT_LIMIT 2.0e-3    /* mm */
#define SLOPE_LIMIT 2.0e-5    /* of the largest entry */
#define DIRECTION_LIMIT 2.0e-6
#define ORIENT_LIMIT 2.0e-3    /* the sine of a small angle loses half of the digits */
#define DIFFERENCE_LIMIT 0.2
#define STEP 1.0e-1
#else
#define POINT_LIMIT 1.0e-9
#define SLOPE_LIMIT 1.0e-12
#define DIRECTION_LIMIT 1.0e-12
#define ORIENT_LIMIT 1.0e-9
#define DIFFERENCE_LIMIT 1.0e-6
#define STEP 1.0e-4
#endif
#define VECTORS $vectors

static const double vector_q[VECTORS][${PREFIX}_AXES] = {
$vector_q
};
static const double vector_tool[3] = { $vector_tool };
static const double vector_p[${PREFIX}_P_SIZE] = {
    $vector_p
};
static const double vector_position[VECTORS][3] = {
$vector_position
};
static const double vector_direction[VECTORS][3] = {
$vector_direction
};
static const double vector_by_q[VECTORS][3 * ${PREFIX}_AXES] = {
$vector_by_q
};
$vector_by_p

static int failures = 0;

/* Counts and prints a deviation beyond its limit, or one that is not a number. */
static void expect(const char *what, int number, double deviation, double limit)
{
    if (!(deviation <= limit)) {
        ++failures;
        printf("%s, vector %d: off by %g, allowed %g\n", what, number, deviation, limit);
    }
}

/* The largest difference of two arrays over the largest entry of the second (over 1 where `relative` is 0). */
static double apart(int count, const ${prefix}_real *found, const double *wanted, int relative)
{
    double most = 0.0;
    double size = 0.0;
    int i;

    for (i = 0; i < count; ++i) {
        const double difference = fabs((double)found[i] - wanted[i]);
        if (!(difference <= most)) {
            most = difference;
        }
        if (fabs(wanted[i]) > size) {
            size = fabs(wanted[i]);
        }
    }
    return ((relative != 0) && (size > 0.0)) ? (most / size) : most;
}

static void load(int number, ${prefix}_real q[${PREFIX}_AXES], ${prefix}_real tool[3], ${prefix}_real p[${PREFIX}_P_SIZE])
{
    int i;

    for (i = 0; i < ${PREFIX}_AXES; ++i) {
        q[i] = (${prefix}_real)vector_q[number][i];
    }
    for (i = 0; i < 3; ++i) {
        tool[i] = (${prefix}_real)vector_tool[i];
    }
    for (i = 0; i < ${PREFIX}_P_SIZE; ++i) {
        p[i] = (${prefix}_real)vector_p[i];
    }
}

static void check_vectors(int number)
{
    ${prefix}_real q[${PREFIX}_AXES];
    ${prefix}_real tool[3];
    ${prefix}_real p[${PREFIX}_P_SIZE];
    ${prefix}_real position[3];
    ${prefix}_real direction[3];
    ${prefix}_real by_q[3 * ${PREFIX}_AXES];
    ${prefix}_real direction_by_q[3 * ${PREFIX}_AXES];

    load(number, q, tool, p);
    expect("status of forward", number, (double)${prefix}_forward(q, tool, p, position, direction), 0.0);
    expect("position", number, apart(3, position, vector_position[number], 0), POINT_LIMIT);
    expect("direction", number, apart(3, direction, vector_direction[number], 0), DIRECTION_LIMIT);
    (void)${prefix}_axis_jacobian(q, tool, p, by_q, direction_by_q);
    expect("axis jacobian", number, apart(3 * ${PREFIX}_AXES, by_q, vector_by_q[number], 1), SLOPE_LIMIT);
$check_by_p}

/* What is not finite is refused, in every place of the arguments. */
static void check_refusals(int number)
{
    ${prefix}_real q[${PREFIX}_AXES];
    ${prefix}_real tool[3];
    ${prefix}_real p[${PREFIX}_P_SIZE];
    ${prefix}_real position[3];
    ${prefix}_real direction[3];
    int i;

    for (i = 0; i < (${PREFIX}_AXES + 3 + ${PREFIX}_P_SIZE); ++i) {
        ${prefix}_real *wrong = &q[0];

        load(number, q, tool, p);
        if (i < ${PREFIX}_AXES) {
            wrong = &q[i];
        } else if (i < (${PREFIX}_AXES + 3)) {
            wrong = &tool[i - ${PREFIX}_AXES];
        } else {
            wrong = &p[i - ${PREFIX}_AXES - 3];
        }
        *wrong = ((i % 2) == 0) ? (${prefix}_real)NAN : (${prefix}_real)HUGE_VAL;
        if (${prefix}_forward(q, tool, p, position, direction) != ${PREFIX}_INVALID) {
            expect("refusal", i, 1.0, 0.0);
        }
    }
}

/* Central differences of the forward function against both Jacobians of the axes. */
static void check_differences(int number)
{
    ${prefix}_real q[${PREFIX}_AXES];
    ${prefix}_real tool[3];
    ${prefix}_real p[${PREFIX}_P_SIZE];
    ${prefix}_real by_q[3 * ${PREFIX}_AXES];
    ${prefix}_real direction_by_q[3 * ${PREFIX}_AXES];
    int k;
    int i;

    load(number, q, tool, p);
    ${prefix}_axis_jacobian(q, tool, p, by_q, direction_by_q);
    for (k = 0; k < ${PREFIX}_AXES; ++k) {
        const ${prefix}_real middle = q[k];
        const ${prefix}_real above = middle + (${prefix}_real)STEP;
        const ${prefix}_real below = middle - (${prefix}_real)STEP;
        ${prefix}_real plus[3];
        ${prefix}_real minus[3];
        ${prefix}_real plus_direction[3];
        ${prefix}_real minus_direction[3];

        q[k] = above;
        ${prefix}_forward(q, tool, p, plus, plus_direction);
        q[k] = below;
        ${prefix}_forward(q, tool, p, minus, minus_direction);
        q[k] = middle;
        for (i = 0; i < 3; ++i) {
            const double slope = (double)((plus[i] - minus[i]) / (above - below));
            const double turn = (double)((plus_direction[i] - minus_direction[i]) / (above - below));
            const double size = 1.0 + fabs((double)by_q[(3 * k) + i]);

            expect("difference of position", number, fabs(slope - (double)by_q[(3 * k) + i]) / size, DIFFERENCE_LIMIT);
            expect("difference of direction", number, fabs(turn - (double)direction_by_q[(3 * k) + i]), DIFFERENCE_LIMIT);
        }
    }
}
$check_inverse
int main(void)
{
    int number;

    for (number = 0; number < VECTORS; ++number) {
        check_vectors(number);
        check_differences(number);
        check_refusals(number);
$call_inverse    }
    printf("%s: %d failures\n", ${PREFIX}_MODEL, failures);
    return (failures == 0) ? 0 : 1;
}
