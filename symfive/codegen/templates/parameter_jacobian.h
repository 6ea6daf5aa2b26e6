
/* Derivatives of the real point by every parameter (mm per unit of the parameter). */
int ${prefix}_parameter_jacobian(const ${prefix}_real q[${PREFIX}_AXES], const ${prefix}_real tool[3],
                          const ${prefix}_real p[${PREFIX}_P_SIZE],
                          ${prefix}_real by_p[3 * ${PREFIX}_PARAMETERS]);

/* Derivatives of the real direction by every parameter (rad per unit of the parameter). */
int ${prefix}_direction_jacobian(const ${prefix}_real q[${PREFIX}_AXES], const ${prefix}_real tool[3],
                          const ${prefix}_real p[${PREFIX}_P_SIZE],
                          ${prefix}_real direction_by_p[3 * ${PREFIX}_PARAMETERS]);
