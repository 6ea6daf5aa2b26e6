
/*
 * Nominal inverse. On entry q holds the positions of all axes but $solved; on success these bring the nominal point to
 * target. ${PREFIX}_UNREACHABLE where their directions, seen from the workpiece, lie in one plane.
 */
int ${prefix}_inverse_nominal(const ${prefix}_real target[3], const ${prefix}_real tool[3],
                       ${prefix}_real q[${PREFIX}_AXES]);

/*
 * Compensated inverse: the same for the real machine, to ${PREFIX}_TOLERANCE mm. It is the inverse of ${prefix}_forward at
 * the given rotary positions. Newton's iteration with the exact Jacobian, at most ${PREFIX}_ITERATIONS steps.
 */
int ${prefix}_inverse(const ${prefix}_real target[3], const ${prefix}_real tool[3],
               const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real q[${PREFIX}_AXES]);

/* Commands q that put the real point where ${prefix}_nominal(wanted) says; only $solved differ from wanted. */
int ${prefix}_compensate(const ${prefix}_real wanted[${PREFIX}_AXES], const ${prefix}_real tool[3],
                  const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real q[${PREFIX}_AXES]);

#define ${PREFIX}_ITERATIONS 12
#ifdef ${PREFIX}_FLOAT
#define ${PREFIX}_TOLERANCE 1.0e-3
#else
#define ${PREFIX}_TOLERANCE 1.0e-10
#endif
