static ${prefix}_real dot3(const ${prefix}_real a[3], const ${prefix}_real b[3])
{
    return (a[0] * b[0]) + (a[1] * b[1]) + (a[2] * b[2]);
}

/* The angle about the unit vector e that turns u into v (both with the same component along e). */
static ${prefix}_real angle_about(const ${prefix}_real e[3], const ${prefix}_real u[3], const ${prefix}_real v[3])
{
    const ${prefix}_real cross[3] = { (u[1] * v[2]) - (u[2] * v[1]), (u[2] * v[0]) - (u[0] * v[2]),
                               (u[0] * v[1]) - (u[1] * v[0]) };

    return ${PREFIX}_ATAN2(dot3(e, cross), dot3(u, v) - (dot3(e, u) * dot3(e, v)));
}

/* The same angle in the turn that is nearest to a reference. */
static ${prefix}_real nearest_turn(${prefix}_real angle, ${prefix}_real reference)
{
    const ${prefix}_real turn = (${prefix}_real)6.283185307179586;

    return angle + (turn * ${PREFIX}_FLOOR(((reference - angle) / turn) + (${prefix}_real)0.5));
}

/*
 * Two turns about crossing directions (Paden and Kahan's second subproblem): the tool's axis turned by the second axis and
 * the wanted direction turned back by the first one are the same vector c; its components along both axes are known.
 */
static int turned(const ${prefix}_real direction[3], ${prefix}_real q[${PREFIX}_AXES])
{
    const ${prefix}_real first[3] = { $first_axis };
    const ${prefix}_real second[3] = { $second_axis };
    const ${prefix}_real normal[3] = { $normal_axis };
    const ${prefix}_real tool_axis[3] = { (${prefix}_real)0.0, (${prefix}_real)0.0, (${prefix}_real)1.0 };
    const ${prefix}_real one = (${prefix}_real)1.0;
    const ${prefix}_real both = dot3(first, second);
    const ${prefix}_real wide = one - (both * both);
    const ${prefix}_real along = dot3(direction, first);
    const ${prefix}_real own = dot3(tool_axis, second);
    const ${prefix}_real a = (along - (both * own)) / wide;
    const ${prefix}_real b = (own - (both * along)) / wide;
    const ${prefix}_real rest = (one - ((a * a) + (b * b) + ((${prefix}_real)2.0 * a * b * both))) / wide;
    const ${prefix}_real slack = ${PREFIX}_SLACK;
    int status = ${PREFIX}_OK;

    if (!(rest >= -slack)) {
        status = ${PREFIX}_UNREACHABLE;
    } else {
        const ${prefix}_real height = (rest > (${prefix}_real)0.0) ? ${PREFIX}_SQRT(rest) : (${prefix}_real)0.0;
        const ${prefix}_real sine2 = one - (along * along);
        ${prefix}_real best[2] = { q[$first_place], q[$second_place] };
        ${prefix}_real least = (${prefix}_real)-1.0;
        int side;

        if (sine2 <= slack) {
            status = ${PREFIX}_SINGULAR;
        }
        for (side = -1; side <= 1; side += 2) {
            const ${prefix}_real h = (side < 0) ? -height : height;
            const ${prefix}_real c[3] = { (a * first[0]) + (b * second[0]) + (h * normal[0]),
                                   (a * first[1]) + (b * second[1]) + (h * normal[1]),
                                   (a * first[2]) + (b * second[2]) + (h * normal[2]) };
            const ${prefix}_real q2 = nearest_turn(angle_about(second, tool_axis, c), q[$second_place]);
            const ${prefix}_real q1 = (status == ${PREFIX}_SINGULAR)
                                   ? q[$first_place]
                                   : nearest_turn(angle_about(first, c, direction), q[$first_place]);
            const ${prefix}_real d1 = q1 - q[$first_place];
            const ${prefix}_real d2 = q2 - q[$second_place];
            const ${prefix}_real far = (d1 * d1) + (d2 * d2);

            if ((least < (${prefix}_real)0.0) || (far < least)) {
                least = far;
                best[0] = q1;
                best[1] = q2;
            }
        }
        q[$first_place] = best[0];
        q[$second_place] = best[1];
    }
    return status;
}

int ${prefix}_orient(const ${prefix}_real direction[3], ${prefix}_real q[${PREFIX}_AXES])
{
    const ${prefix}_real slack = (${prefix}_real)${PREFIX}_UNIT_TOLERANCE;
    const ${prefix}_real one = (${prefix}_real)1.0;
    int status = ${PREFIX}_INVALID;

    if ((sound(3, direction, one + slack) != 0) && (sound(${PREFIX}_AXES, q, (${prefix}_real)${PREFIX}_FARTHEST) != 0)) {
        const ${prefix}_real length = ${PREFIX}_SQRT(dot3(direction, direction));

        if (${PREFIX}_FABS(length - one) <= slack) {
            const ${prefix}_real unit[3] = { direction[0] / length, direction[1] / length, direction[2] / length };

            status = turned(unit, q);
        }
    }
    return status;
}
