/*
 * sf.h: exact kinematics of "tilting table BC" with its errors, and their derivatives.
 *
 * Made by symfive 0.1.0 from the model below; change the model, not this file.
 *   structure    w C' B' X' Y' b Z t   (ISO 10791-6, from the workpiece over the bed to the tool)
 *   model        sha256 74a1813ac4abe34ed5aac8b3a152445812b6762ed1acfd3276113623cfb8024c
 *   values       identified
 *
 * Units          lengths mm, angles rad, parameters as listed below (um = micrometre, urad = microradian).
 * Signs          ISO 841: a positive command moves the tool relative to the workpiece in the positive direction.
 * Frames         right-handed; machine, workpiece and tool frame coincide when every axis stands at zero.
 * tool           the tool's point in the tool frame; for a tool of length L it is (0, 0, -L).
 * direction      the tool frame's z axis in the workpiece frame, a unit vector from the tool's point to the spindle.
 * Jacobians      three rows, column by column: J[3*k + i] is the derivative of component i by unknown k.
 * Memory         all of it belongs to the caller; nothing is allocated, there is no global state; every function may run in
 *                several threads at once and may be given arrays that overlap.
 * Arguments      all are checked: finite; q, tool and points up to SF_FARTHEST, p up to SF_LARGEST, unit vectors.
 * Precision      double, or float where SF_FLOAT is defined for every file that includes this one.
 *
 * Order of q:
 *   q[0] Y, mm: linear, carries the workpiece, direction (0, 1, 0), travel -250 ... 250 mm
 *   q[1] X, mm: linear, carries the workpiece, direction (1, 0, 0), travel -300 ... 300 mm
 *   q[2] B, rad: rotary, carries the workpiece, direction (0, 1, 0), through (0, 0, 0) mm, travel -110 ... 110 deg
 *   q[3] C, rad: rotary, carries the workpiece, direction (0, 0, 1), through (0, 0, 0) mm, travel -180 ... 180 deg
 *   q[4] Z, mm: linear, carries the tool, direction (0, 0, 1), travel -100 ... 450 mm
 *
 * Order of p:
 *   p[0] EC0X, urad
 *   p[1] EX0B, um
 *   p[2] EA0B, urad
 *   p[3] EX0C, um
 *   p[4] EA0C, urad
 *   p[5] EXC.cos1, um
 *   p[6] EXC.sin1, um
 *   p[7] EXC.cos2, um
 *   p[8] EXC.sin2, um
 *
 * Cost (operations; values live at one time, which is about what is kept on the stack in optimised code; stack in bytes
 * without optimisation, double):
 *   sf_forward: 129 operations, 30 live, at most 760 bytes
 *   sf_nominal: 37 operations, 14 live, at most 384 bytes
 *   sf_axis_jacobian: 204 operations, 43 live, at most 960 bytes
 *   sf_parameter_jacobian: 199 operations, 34 live, at most 880 bytes
 *   sf_direction_jacobian: 64 operations, 17 live, at most 488 bytes
 *   (nominal_slope): 39 operations, 14 live, at most 392 bytes
 *   (real_slope): 140 operations, 32 live, at most 768 bytes
 *   An inverse takes 2 or 3 steps of (real_slope), one of (nominal_slope), and 1000 bytes beyond theirs.
 */
#ifndef SF_H
#define SF_H

#ifdef __cplusplus
extern "C" {
#endif

#ifdef SF_FLOAT
typedef float sf_real;
#else
typedef double sf_real;
#endif

#define SF_AXES 5
#define SF_PARAMETERS 9
#define SF_P_SIZE 9 /* length of the array p: at least one, since C has no empty arrays */
#define SF_MODEL "74a1813ac4abe34ed5aac8b3a152445812b6762ed1acfd3276113623cfb8024c"

/*
 * What the functions return. Results may be used after SF_OK and SF_SINGULAR, and are finite then. After anything else
 * an array q that is an input too is as it was, and other results must not be used.
 */
#define SF_OK 0            /* done */
#define SF_SINGULAR 1      /* near a singular pose: done as far as the function says there */
#define SF_UNREACHABLE 2   /* no position of the axes has the wanted point or direction */
#define SF_NOT_CONVERGED 3 /* the iteration found no solution */
#define SF_INVALID 4       /* an argument is not finite or too large, or a direction is not a unit vector */

#define SF_FARTHEST 1.0e5 /* mm and rad */
#define SF_LARGEST 1.0e30

/* The identified values of the parameters (their prior means where nothing was identified). */
void sf_parameters(sf_real p[SF_P_SIZE]);

/* SF_MODEL of the sources that the library was compiled from. */
const char *sf_model(void);

/* Name of parameter 0 ... SF_PARAMETERS - 1, an empty text for any other index. */
const char *sf_parameter_name(int index);

/* Where the real tool is: its point (mm) and direction in the workpiece frame. */
int sf_forward(const sf_real q[SF_AXES], const sf_real tool[3],
               const sf_real p[SF_P_SIZE], sf_real position[3], sf_real direction[3]);

/* Where the tool of the machine without errors is. */
int sf_nominal(const sf_real q[SF_AXES], const sf_real tool[3],
               sf_real position[3], sf_real direction[3]);

/* Volumetric error: real minus nominal point (mm) and direction (rad), in the workpiece frame. */
int sf_error(const sf_real q[SF_AXES], const sf_real tool[3],
             const sf_real p[SF_P_SIZE], sf_real error[3], sf_real tilt[3]);

/* Derivatives of the real point (mm per mm or rad) and direction by the axes' commands. */
int sf_axis_jacobian(const sf_real q[SF_AXES], const sf_real tool[3],
                     const sf_real p[SF_P_SIZE], sf_real by_q[3 * SF_AXES],
                     sf_real direction_by_q[3 * SF_AXES]);

/* Derivatives of the real point by every parameter (mm per unit of the parameter). */
int sf_parameter_jacobian(const sf_real q[SF_AXES], const sf_real tool[3],
                          const sf_real p[SF_P_SIZE],
                          sf_real by_p[3 * SF_PARAMETERS]);

/* Derivatives of the real direction by every parameter (rad per unit of the parameter). */
int sf_direction_jacobian(const sf_real q[SF_AXES], const sf_real tool[3],
                          const sf_real p[SF_P_SIZE],
                          sf_real direction_by_p[3 * SF_PARAMETERS]);

/*
 * Nominal inverse. On entry q holds the positions of all axes but X, Y, Z; on success these bring the nominal point to
 * target. SF_UNREACHABLE where their directions, seen from the workpiece, lie in one plane.
 */
int sf_inverse_nominal(const sf_real target[3], const sf_real tool[3],
                       sf_real q[SF_AXES]);

/*
 * Compensated inverse: the same for the real machine, to SF_TOLERANCE mm. It is the inverse of sf_forward at
 * the given rotary positions. Newton's iteration with the exact Jacobian, at most SF_ITERATIONS steps.
 */
int sf_inverse(const sf_real target[3], const sf_real tool[3],
               const sf_real p[SF_P_SIZE], sf_real q[SF_AXES]);

/* Commands q that put the real point where sf_nominal(wanted) says; only X, Y, Z differ from wanted. */
int sf_compensate(const sf_real wanted[SF_AXES], const sf_real tool[3],
                  const sf_real p[SF_P_SIZE], sf_real q[SF_AXES]);

#define SF_ITERATIONS 12
#ifdef SF_FLOAT
#define SF_TOLERANCE 1.0e-3
#else
#define SF_TOLERANCE 1.0e-10
#endif

#define SF_UNIT_TOLERANCE 1.0e-3 /* a direction whose length is nearer to 1 is made a unit vector, any other refused */

/*
 * Rotary axes C and B for a tool direction (nominal). q enters as the position to stay near to (whole turns are
 * kept) and leaves with C and B replaced. SF_SINGULAR: the direction lies along axis C to 1 microradian;
 * C is then free and stays as it was.
 */
int sf_orient(const sf_real direction[3], sf_real q[SF_AXES]);

/*
 * Commands q that put the real point and the real direction where sf_nominal(wanted) says; X, Y, Z, C and
 * B differ from wanted. SF_SINGULAR: near a pose where the direction lies along axis C or at the edge of what
 * the axes reach, so that a tilt asks for a larger motion; the point is right, and of the tilt that part is taken away for which
 * commands change smoothly, from all at the region's edge to what the free combination of the axes leaves at the pose itself.
 * The region is about 2 sqrt(tilt) wide in rad. Commands then move at most 2 times as far as wanted poses.
 */
int sf_compensate_direction(const sf_real wanted[SF_AXES], const sf_real tool[3],
                            const sf_real p[SF_P_SIZE], sf_real q[SF_AXES]);

#ifdef __cplusplus
}
#endif

#endif
