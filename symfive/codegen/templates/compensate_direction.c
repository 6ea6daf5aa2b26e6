/*
 * What is solved near a wanted pose: the rotary axes' steps x that take away the tilt of the real tool, base' (now - direction) = 0
 * with the slopes `base` of the direction there. Where their smallest singular value s is below a width w, a tilt asks for
 * motions that are larger than itself by 1 / s; the factor is then s (2 w^2 - s^2) / w^4, which passes into 1 / s at w without
 * a kink and is nothing at the singular pose itself. It is what a spring along the weak combination of the axes does:
 * base' (now - direction) + hold x = 0. With w^2 = 4 tilts the commands turn at most half as far more as is wanted.
 */
static int held(const ${prefix}_real first[3], const ${prefix}_real second[3], ${prefix}_real tilt, ${prefix}_real hold[3])
{
    const ${prefix}_real two = (${prefix}_real)2.0;
    const ${prefix}_real a = dot3(first, first);
    const ${prefix}_real b = dot3(first, second);
    const ${prefix}_real c = dot3(second, second);
    const ${prefix}_real apart = ${PREFIX}_SQRT(((a - c) * (a - c)) + (two * two * b * b));
    const ${prefix}_real strong = (a + c + apart) / two;
    const ${prefix}_real weak = ((a * c) - (b * b)) / strong; /* the square of s */
    const ${prefix}_real width = ${PREFIX}_NARROWEST + (two * two * tilt);
    int near = 0;

    hold[0] = (${prefix}_real)0.0;
    hold[1] = (${prefix}_real)0.0;
    hold[2] = (${prefix}_real)0.0;
    if ((weak < width) && (apart > (${prefix}_real)0.0)) {
        const ${prefix}_real spring = (((width * width) / ((two * width) - weak)) - weak) / apart;

        hold[0] = spring * (strong - a);
        hold[1] = -(spring * b);
        hold[2] = spring * (strong - c);
        near = 1;
    }
    return near;
}

int ${prefix}_compensate_direction(const ${prefix}_real wanted[${PREFIX}_AXES], const ${prefix}_real tool[3],
                            const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real q[${PREFIX}_AXES])
{
    ${prefix}_real target[3];
    ${prefix}_real direction[3];
    ${prefix}_real found[${PREFIX}_AXES];
    ${prefix}_real first[3];
    ${prefix}_real second[3];
    ${prefix}_real hold[3];
    ${prefix}_real x[2] = { (${prefix}_real)0.0, (${prefix}_real)0.0 };
    int status = ${prefix}_nominal(wanted, tool, target, direction);
    int near = 0;
    int going = 1;
    int step = 0;
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
    while ((going != 0) && (status == ${PREFIX}_OK)) {
        ${prefix}_real position[3];
        ${prefix}_real now[3];
        ${prefix}_real by_q[3 * ${PREFIX}_AXES];
        ${prefix}_real slopes[3 * ${PREFIX}_AXES];
        ${prefix}_real tilt[3];

        (void)${prefix}_forward(found, tool, p, position, now);
        (void)${prefix}_axis_jacobian(found, tool, p, by_q, slopes);
        for (i = 0; i < 3; ++i) {
            tilt[i] = direction[i] - now[i];
        }
        if (step == 0) {
            for (i = 0; i < 3; ++i) {
                first[i] = slopes[$first_column + i];
                second[i] = slopes[$second_column + i];
            }
            near = held(first, second, ${PREFIX}_SQRT(dot3(tilt, tilt)), hold);
        }
        {
            const ${prefix}_real u = dot3(first, tilt) - ((hold[0] * x[0]) + (hold[1] * x[1]));
            const ${prefix}_real v = dot3(second, tilt) - ((hold[1] * x[0]) + (hold[2] * x[1]));
            const ${prefix}_real m00 = dot3(first, &slopes[$first_column]) + hold[0];
            const ${prefix}_real m01 = dot3(first, &slopes[$second_column]) + hold[1];
            const ${prefix}_real m10 = dot3(second, &slopes[$first_column]) + hold[1];
            const ${prefix}_real m11 = dot3(second, &slopes[$second_column]) + hold[2];
            const ${prefix}_real determinant = (m00 * m11) - (m01 * m10);
            const ${prefix}_real by[2] = { ((m11 * u) - (m01 * v)) / determinant, ((m00 * v) - (m10 * u)) / determinant };

            if ((step >= ${PREFIX}_ITERATIONS) || (sound(2, by, (${prefix}_real)1.0) == 0)) {
                status = ${PREFIX}_NOT_CONVERGED;
            } else {
                x[0] += by[0];
                x[1] += by[1];
                found[$first_place] = wanted[$first_place] + x[0];
                found[$second_place] = wanted[$second_place] + x[1];
                status = approach(target, tool, p, found);
                if (sound(2, by, ${PREFIX}_LAST_TURN) != 0) {
                    going = 0;
                }
            }
        }
        ++step;
    }
    if ((status == ${PREFIX}_OK) && (near != 0)) {
        status = ${PREFIX}_SINGULAR;
    }
    return taken(status, found, q);
}
