
/* Forward and inverse are each other's inverse; compensated commands bring the real tool to the nominal place. */
static void check_inverse(int number)
{
    ${prefix}_real q[${PREFIX}_AXES];
    ${prefix}_real again[${PREFIX}_AXES];
    ${prefix}_real tool[3];
    ${prefix}_real p[${PREFIX}_P_SIZE];
    ${prefix}_real position[3];
    ${prefix}_real direction[3];
    ${prefix}_real reached[3];
    double wanted[3];
    int status;
    int i;

    load(number, q, tool, p);
    ${prefix}_forward(q, tool, p, position, direction);
    for (i = 0; i < ${PREFIX}_AXES; ++i) {
        again[i] = q[i];
    }
$scatter    status = ${prefix}_inverse(position, tool, p, again);
    if (status != ${PREFIX}_UNREACHABLE) {
        expect("status of inverse", number, (double)status, 0.0);
        for (i = 0; i < ${PREFIX}_AXES; ++i) {
            const double back = (double)q[i];
            expect("inverse of forward", number, apart(1, &again[i], &back, 0), POINT_LIMIT);
        }
    }
    ${prefix}_nominal(q, tool, position, direction);
    status = ${prefix}_compensate(q, tool, p, again);
    if (status != ${PREFIX}_UNREACHABLE) {
        expect("status of compensate", number, (double)status, 0.0);
        ${prefix}_forward(again, tool, p, reached, direction);
        for (i = 0; i < 3; ++i) {
            wanted[i] = (double)position[i];
        }
        expect("compensated position", number, apart(3, reached, wanted, 0), POINT_LIMIT);
    }
}
