/* Steps of the two rotary axes that turn the direction by `turn`, least squares; 0 near a singular pose. */
static int solve_direction(const ${prefix}_real first[3], const ${prefix}_real second[3], const ${prefix}_real turn[3],
                           ${prefix}_real x[2])
{
    const ${prefix}_real a = dot3(first, first);
    const ${prefix}_real b = dot3(first, second);
    const ${prefix}_real c = dot3(second, second);
    const ${prefix}_real determinant = (a * c) - (b * b);
    const ${prefix}_real least = (${prefix}_real)1.0e-4;
    int solved = 0;

    if (determinant > least) {
        const ${prefix}_real u = dot3(first, turn);
        const ${prefix}_real v = dot3(second, turn);

        x[0] = ((c * u) - (b * v)) / determinant;
        x[1] = ((a * v) - (b * u)) / determinant;
        solved = 1;
    }
    return solved;
}

/* One sweep: the rotary axes for the direction, then the point at the new rotary positions. */
static int turn_once(const ${prefix}_real target[3], const ${prefix}_real direction[3], const ${prefix}_real tool[3],
                     const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real q[${PREFIX}_AXES], ${prefix}_real x[2])
{
    ${prefix}_real position[3];
    ${prefix}_real now[3];
    ${prefix}_real by_q[3 * ${PREFIX}_AXES];
    ${prefix}_real direction_by_q[3 * ${PREFIX}_AXES];
    ${prefix}_real turn[3];
    int status = ${PREFIX}_SINGULAR;
    int i;

    ${prefix}_forward(q, tool, p, position, now);
    ${prefix}_axis_jacobian(q, tool, p, by_q, direction_by_q);
    for (i = 0; i < 3; ++i) {
        turn[i] = direction[i] - now[i];
    }
    if (solve_direction(&direction_by_q[$first_column], &direction_by_q[$second_column], turn, x) != 0) {
        q[$first_place] += x[0];
        q[$second_place] += x[1];
        status = approach(target, tool, p, q);
    }
    return status;
}

int ${prefix}_compensate_direction(const ${prefix}_real wanted[${PREFIX}_AXES], const ${prefix}_real tool[3],
                            const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real q[${PREFIX}_AXES])
{
    const ${prefix}_real small = ${PREFIX}_LAST_TURN;
    ${prefix}_real target[3];
    ${prefix}_real direction[3];
    ${prefix}_real safe[${PREFIX}_AXES];
    int status;
    int step = 0;
    int going = 1;
    int i;

    ${prefix}_nominal(wanted, tool, target, direction);
    for (i = 0; i < ${PREFIX}_AXES; ++i) {
        q[i] = wanted[i];
    }
    status = approach(target, tool, p, q);
    for (i = 0; i < ${PREFIX}_AXES; ++i) {
        safe[i] = q[i];
    }
    while ((going != 0) && (status == ${PREFIX}_OK)) {
        ${prefix}_real x[2] = { (${prefix}_real)0.0, (${prefix}_real)0.0 };

        status = turn_once(target, direction, tool, p, q, x);
        if ((status == ${PREFIX}_OK) && (${PREFIX}_FABS(x[0]) <= small) && (${PREFIX}_FABS(x[1]) <= small)) {
            going = 0;
        } else if (step >= ${PREFIX}_ITERATIONS) {
            status = ${PREFIX}_NOT_CONVERGED;
        } else {
            ++step;
        }
    }
    if (status == ${PREFIX}_SINGULAR) {
        for (i = 0; i < ${PREFIX}_AXES; ++i) {
            q[i] = safe[i];
        }
    }
    return status;
}
