
#define ${PREFIX}_UNIT_TOLERANCE 1.0e-3 /* a direction whose length is nearer to 1 is made a unit vector, any other refused */

/*
 * Rotary axes $first and $second for a tool direction (nominal). q enters as the position to stay near to (whole turns are
 * kept) and leaves with $first and $second replaced. ${PREFIX}_SINGULAR: the direction lies along axis $first to 1 microradian;
 * $first is then free and stays as it was.
 */
int ${prefix}_orient(const ${prefix}_real direction[3], ${prefix}_real q[${PREFIX}_AXES]);
