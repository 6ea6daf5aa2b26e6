/* Solves a 3x3 system, matrix column by column, by its cofactors; 0 where the columns lie in one plane. */
static int solve3(const ${prefix}_real m[9], const ${prefix}_real right[3], ${prefix}_real x[3])
{
    const ${prefix}_real c0 = (m[4] * m[8]) - (m[5] * m[7]);
    const ${prefix}_real c1 = (m[5] * m[6]) - (m[3] * m[8]);
    const ${prefix}_real c2 = (m[3] * m[7]) - (m[4] * m[6]);
    const ${prefix}_real determinant = (m[0] * c0) + (m[1] * c1) + (m[2] * c2);
    const ${prefix}_real least = (${prefix}_real)1.0e-4;
    int solved = 0;

    if ((determinant > least) || (determinant < -least)) {
        const ${prefix}_real s0 = (right[1] * m[8]) - (right[2] * m[7]);
        const ${prefix}_real s1 = (right[2] * m[6]) - (right[0] * m[8]);
        const ${prefix}_real s2 = (right[0] * m[7]) - (right[1] * m[6]);
        const ${prefix}_real r0 = (m[4] * right[2]) - (m[5] * right[1]);
        const ${prefix}_real r1 = (m[5] * right[0]) - (m[3] * right[2]);
        const ${prefix}_real r2 = (m[3] * right[1]) - (m[4] * right[0]);

        x[0] = ((right[0] * c0) + (right[1] * c1) + (right[2] * c2)) / determinant;
        x[1] = ((m[0] * s0) + (m[1] * s1) + (m[2] * s2)) / determinant;
        x[2] = ((m[0] * r0) + (m[1] * r1) + (m[2] * r2)) / determinant;
        solved = 1;
    }
    return solved;
}

int ${prefix}_inverse_nominal(const ${prefix}_real target[3], const ${prefix}_real tool[3],
                       ${prefix}_real q[${PREFIX}_AXES])
{
    const int solved[3] = { $solved_places };
    const ${prefix}_real farthest = (${prefix}_real)${PREFIX}_FARTHEST;
    ${prefix}_real start[${PREFIX}_AXES];
    int status = ${PREFIX}_INVALID;
    int i;

    for (i = 0; i < ${PREFIX}_AXES; ++i) {
        start[i] = q[i];
    }
    for (i = 0; i < 3; ++i) {
        start[solved[i]] = (${prefix}_real)0.0;
    }
    if ((sound_pose(start, tool) != 0) && (sound(3, target, farthest) != 0)) {
        ${prefix}_real position[3];
        ${prefix}_real slope[9];
        ${prefix}_real missing[3];
        ${prefix}_real x[3];

        status = ${PREFIX}_UNREACHABLE;
        nominal_slope(start, tool, position, slope);
        for (i = 0; i < 3; ++i) {
            missing[i] = target[i] - position[i];
        }
        if ((solve3(slope, missing, x) != 0) && (sound(3, x, farthest) != 0)) {
            for (i = 0; i < 3; ++i) {
                q[solved[i]] = x[i];
            }
            status = ${PREFIX}_OK;
        }
    }
    return status;
}

static ${prefix}_real largest(const ${prefix}_real x[3])
{
    ${prefix}_real size = ${PREFIX}_FABS(x[0]);
    int i;

    for (i = 1; i < 3; ++i) {
        const ${prefix}_real other = ${PREFIX}_FABS(x[i]);
        if (other > size) {
            size = other;
        }
    }
    return size;
}

/*
 * Newton's iteration for the point. Steps shrink at least as fast from one to the next as they did before, so that what is
 * missing after a step is known without another one. Anything but ${PREFIX}_OK leaves q somewhere.
 */
static int approach(const ${prefix}_real target[3], const ${prefix}_real tool[3],
                    const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real q[${PREFIX}_AXES])
{
    const int solved[3] = { $solved_places };
    const ${prefix}_real farthest = (${prefix}_real)${PREFIX}_FARTHEST;
    const ${prefix}_real tolerance = (${prefix}_real)${PREFIX}_TOLERANCE;
    ${prefix}_real before = (${prefix}_real)0.0;
    int status = ${PREFIX}_NOT_CONVERGED;
    int step = 0;
    int going = 1;

    while ((going != 0) && (step < ${PREFIX}_ITERATIONS)) {
        ${prefix}_real position[3];
        ${prefix}_real slope[9];
        ${prefix}_real missing[3];
        ${prefix}_real x[3];
        int i;

        real_slope(q, tool, p, position, slope);
        for (i = 0; i < 3; ++i) {
            missing[i] = target[i] - position[i];
        }
        if (solve3(slope, missing, x) == 0) {
            status = ${PREFIX}_UNREACHABLE;
            going = 0;
        } else if (sound(3, x, farthest) == 0) {
            going = 0;
        } else {
            const ${prefix}_real size = largest(x);

            for (i = 0; i < 3; ++i) {
                q[solved[i]] += x[i];
            }
            if ((size <= tolerance) || ((size < before) && ((size * size) <= (tolerance * before)))) {
                status = ${PREFIX}_UNREACHABLE;
                going = 0;
                if (sound(${PREFIX}_AXES, q, farthest) != 0) {
                    status = ${PREFIX}_OK;
                }
            }
            before = size;
        }
        ++step;
    }
    return status;
}

/* The result of a solution that may be used, otherwise q stays as it is. */
static int taken(int status, const ${prefix}_real found[${PREFIX}_AXES], ${prefix}_real q[${PREFIX}_AXES])
{
    int i;

    for (i = 0; ((status == ${PREFIX}_OK) || (status == ${PREFIX}_SINGULAR)) && (i < ${PREFIX}_AXES); ++i) {
        q[i] = found[i];
    }
    return status;
}

int ${prefix}_inverse(const ${prefix}_real target[3], const ${prefix}_real tool[3],
               const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real q[${PREFIX}_AXES])
{
    ${prefix}_real found[${PREFIX}_AXES];
    int status;
    int i;

    for (i = 0; i < ${PREFIX}_AXES; ++i) {
        found[i] = q[i];
    }
    status = (sound_parameters(p) != 0) ? ${prefix}_inverse_nominal(target, tool, found) : ${PREFIX}_INVALID;
    if (status == ${PREFIX}_OK) {
        status = approach(target, tool, p, found);
    }
    return taken(status, found, q);
}

int ${prefix}_compensate(const ${prefix}_real wanted[${PREFIX}_AXES], const ${prefix}_real tool[3],
                  const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real q[${PREFIX}_AXES])
{
    ${prefix}_real target[3];
    ${prefix}_real direction[3];
    ${prefix}_real found[${PREFIX}_AXES];
    int status = ${prefix}_nominal(wanted, tool, target, direction);
    int i;

    for (i = 0; i < ${PREFIX}_AXES; ++i) {
        found[i] = wanted[i];
    }
    if ((status == ${PREFIX}_OK) && (sound_parameters(p) == 0)) {
        status = ${PREFIX}_INVALID;
    }
    if (status == ${PREFIX}_OK) {
        status = approach(target, tool, p, found);
    }
    return taken(status, found, q);
}
