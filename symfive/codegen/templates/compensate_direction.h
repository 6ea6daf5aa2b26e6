
/*
 * Commands q that put the real point and the real direction where ${prefix}_nominal(wanted) says; $solved, $first and
 * $second differ from wanted. ${PREFIX}_SINGULAR: near a pose where the direction lies along axis $first or at the edge of what
 * the axes reach, so that a tilt asks for a larger motion; the point is right, and of the tilt that part is taken away for which
 * commands change smoothly, from all at the region's edge to what the free combination of the axes leaves at the pose itself.
 * The region is about 2 sqrt(tilt) wide in rad. Commands then move at most 2 times as far as wanted poses.
 */
int ${prefix}_compensate_direction(const ${prefix}_real wanted[${PREFIX}_AXES], const ${prefix}_real tool[3],
                            const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real q[${PREFIX}_AXES]);
