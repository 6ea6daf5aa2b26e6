
/*
 * Commands q that put the real point and the real direction where ${prefix}_nominal(wanted) says; $solved, $first and
 * $second differ from wanted. ${PREFIX}_SINGULAR: near a pose where the direction lies along axis $first, so that a small
 * tilt would need a large motion; q then compensates the point alone, as ${prefix}_compensate does.
 */
int ${prefix}_compensate_direction(const ${prefix}_real wanted[${PREFIX}_AXES], const ${prefix}_real tool[3],
                            const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real q[${PREFIX}_AXES]);
