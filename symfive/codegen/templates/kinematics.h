/*
 * $prefix.h: exact kinematics of "$machine" with its errors, and their derivatives.
 *
 * Made by symfive $version from the model below; change the model, not this file.
 *   structure    $structure   (ISO 10791-6, from the workpiece over the bed to the tool)
 *   model        sha256 $digest
 *   values       $values_from
$left_out *
 * Units          lengths mm, angles rad, parameters as listed below (um = micrometre, urad = microradian).
 * Signs          ISO 841: a positive command moves the tool relative to the workpiece in the positive direction.
 * Frames         right-handed; machine, workpiece and tool frame coincide when every axis stands at zero.
 * tool           the tool's point in the tool frame; for a tool of length L it is (0, 0, -L).
 * direction      the tool frame's z axis in the workpiece frame, a unit vector from the tool's point to the spindle.
 * Jacobians      three rows, column by column: J[3*k + i] is the derivative of component i by unknown k.
 * Memory         all of it belongs to the caller; nothing is allocated, there is no global state; every function may run in
 *                several threads at once and may be given arrays that overlap.
 * Arguments      all are checked: finite; q, tool and points up to ${PREFIX}_FARTHEST, p up to ${PREFIX}_LARGEST, unit vectors.
 * Precision      double, or float where ${PREFIX}_FLOAT is defined for every file that includes this one.
 *
 * Order of q:
$axis_list *
 * Order of p:
$parameter_list *
 * Cost (operations; values live at one time, which is about what is kept on the stack in optimised code; stack in bytes
 * without optimisation, double):
$cost_list */
#ifndef ${PREFIX}_H
#define ${PREFIX}_H

#ifdef __cplusplus
extern "C" {
#endif

#ifdef ${PREFIX}_FLOAT
typedef float ${prefix}_real;
#else
typedef double ${prefix}_real;
#endif

#define ${PREFIX}_AXES $axes
#define ${PREFIX}_PARAMETERS $parameters
#define ${PREFIX}_P_SIZE $p_size /* length of the array p: at least one, since C has no empty arrays */
#define ${PREFIX}_MODEL "$digest"

/*
 * What the functions return. Results may be used after ${PREFIX}_OK and ${PREFIX}_SINGULAR, and are finite then. After anything else
 * an array q that is an input too is as it was, and other results must not be used.
 */
#define ${PREFIX}_OK 0            /* done */
#define ${PREFIX}_SINGULAR 1      /* near a singular pose: done as far as the function says there */
#define ${PREFIX}_UNREACHABLE 2   /* no position of the axes has the wanted point or direction */
#define ${PREFIX}_NOT_CONVERGED 3 /* the iteration found no solution */
#define ${PREFIX}_INVALID 4       /* an argument is not finite or too large, or a direction is not a unit vector */

#define ${PREFIX}_FARTHEST 1.0e5 /* mm and rad */
#define ${PREFIX}_LARGEST 1.0e30

/* The identified values of the parameters (their prior means where nothing was identified). */
void ${prefix}_parameters(${prefix}_real p[${PREFIX}_P_SIZE]);

/* ${PREFIX}_MODEL of the sources that the library was compiled from. */
const char *${prefix}_model(void);

/* Name of parameter 0 ... ${PREFIX}_PARAMETERS - 1, an empty text for any other index. */
const char *${prefix}_parameter_name(int index);

/* Where the real tool is: its point (mm) and direction in the workpiece frame. */
int ${prefix}_forward(const ${prefix}_real q[${PREFIX}_AXES], const ${prefix}_real tool[3],
               const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real position[3], ${prefix}_real direction[3]);

/* Where the tool of the machine without errors is. */
int ${prefix}_nominal(const ${prefix}_real q[${PREFIX}_AXES], const ${prefix}_real tool[3],
               ${prefix}_real position[3], ${prefix}_real direction[3]);

/* Volumetric error: real minus nominal point (mm) and direction (rad), in the workpiece frame. */
int ${prefix}_error(const ${prefix}_real q[${PREFIX}_AXES], const ${prefix}_real tool[3],
             const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real error[3], ${prefix}_real tilt[3]);

/* Derivatives of the real point (mm per mm or rad) and direction by the axes' commands. */
int ${prefix}_axis_jacobian(const ${prefix}_real q[${PREFIX}_AXES], const ${prefix}_real tool[3],
                     const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real by_q[3 * ${PREFIX}_AXES],
                     ${prefix}_real direction_by_q[3 * ${PREFIX}_AXES]);
$more
#ifdef __cplusplus
}
#endif

#endif
