
/* A direction that the axes have is found again; with its compensation the real tool has it. */
static void check_direction(int number)
{
    ${prefix}_real q[${PREFIX}_AXES];
    ${prefix}_real again[${PREFIX}_AXES];
    ${prefix}_real tool[3];
    ${prefix}_real p[${PREFIX}_P_SIZE];
    ${prefix}_real position[3];
    ${prefix}_real direction[3];
    ${prefix}_real reached[3];
    ${prefix}_real found[3];
    double wanted[3];
    double wanted_direction[3];
    int status;
    int i;

    load(number, q, tool, p);
    ${prefix}_nominal(q, tool, position, direction);
    for (i = 0; i < 3; ++i) {
        wanted[i] = (double)position[i];
        wanted_direction[i] = (double)direction[i];
    }
    for (i = 0; i < ${PREFIX}_AXES; ++i) {
        again[i] = q[i];
    }
    again[$first_place] += (${prefix}_real)0.05;
    again[$second_place] -= (${prefix}_real)0.05;
    status = ${prefix}_orient(direction, again);
    expect("status of orient", number, (double)(status & ~${PREFIX}_SINGULAR), 0.0);
    ${prefix}_nominal(again, tool, reached, found);
    expect("orient", number, apart(3, found, wanted_direction, 0), ORIENT_LIMIT);
    status = ${prefix}_compensate_direction(q, tool, p, again);
    if (status != ${PREFIX}_SINGULAR) {
        expect("status of compensate_direction", number, (double)status, 0.0);
        ${prefix}_forward(again, tool, p, reached, found);
        expect("compensated point", number, apart(3, reached, wanted, 0), POINT_LIMIT);
        expect("compensated direction", number, apart(3, found, wanted_direction, 0), ORIENT_LIMIT);
    }
}
