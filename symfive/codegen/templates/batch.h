/*
 * ${prefix}_batch.h: the real tool's point and its parameter Jacobian for many poses, with the vector types of GCC and Clang.
 *
 * Made by symfive $version from model sha256 $digest.
 * Compile with -std=gnu99 -O2 -march=native, never with -ffast-math. Double precision. Units, signs and orders as in $prefix.h.
 *
 * Poses stand in tiles of ${PREFIX}_LANES: element i of pose n is at [(n / LANES) * size * LANES + i * LANES + n % LANES]. Every
 * array begins at a multiple of 64 bytes; unused lanes of the last tile must hold finite numbers. Angles up to 1e5 rad.
 *
 * Operations a pose for point and Jacobian: $operations (what the parameters alone decide is done once, in prepare).
 */
#ifndef ${PREFIX}_BATCH_H
#define ${PREFIX}_BATCH_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

#ifndef ${PREFIX}_LANES
#define ${PREFIX}_LANES 8 /* poses in a vector, 8 or 4; the same for every file that includes this one */
#endif
#define ${PREFIX}_BATCH_AXES $axes
#define ${PREFIX}_BATCH_PARAMETERS $parameters
#define ${PREFIX}_CONSTANTS $constants
#define ${PREFIX}_NORMAL ($parameters + 1)
#define ${PREFIX}_WORK ((size_t)$vectors * ${PREFIX}_LANES) /* doubles that the information matrix works in */

/* Lanes that this library was compiled with. */
size_t ${prefix}_batch_lanes(void);

/* What does not depend on the pose: c[${PREFIX}_CONSTANTS] from tool[3] and p[$p_size]. */
void ${prefix}_batch_prepare(const double *tool, const double *p, double *c);

/* The point of every pose: position, 3 a pose. */
void ${prefix}_batch_forward(size_t tiles, const double *q, const double *c, double *position);

/* The point and its Jacobian, column by column: 3 * $parameters a pose. `stream`: 1 writes past the caches; 0 through them, each
 * line fetched before it is written. Which is faster for results larger than the caches depends on the processor. */
void ${prefix}_batch_jacobian(size_t tiles, const double *q, const double *c, double *position, double *by_p, int stream);

/*
 * Adds to `normal`, a square matrix of ${PREFIX}_NORMAL rows, the sums over all poses of
 *   J'J   J'r
 *   r'J   r'r     with r = target - point (3 a pose, in tiles),
 * without ever storing J. `work`: ${PREFIX}_WORK doubles.
 */
void ${prefix}_batch_information(size_t poses, const double *q, const double *c, const double *target, double *normal,
                          double *work);

/*
 * J M J' of every pose for a covariance M = F F' of the parameters, 6 a pose in tiles: xx, xy, xz, yy, yz, zz. Its trace and its
 * determinant are what an exchange of poses asks for. `factor`: F, row by row, $parameters rows of `rank` numbers; `work`:
 * ${PREFIX}_WORK doubles. J never leaves the tile.
 */
void ${prefix}_batch_leverage(size_t tiles, const double *q, const double *c, const double *factor, size_t rank,
                       double *leverage, double *work);

/* First-order prediction, 3 a pose in tiles: point + J d for a step d of the parameters; J never leaves the tile. */
void ${prefix}_batch_predict(size_t tiles, const double *q, const double *c, const double *d, double *predicted);

#ifdef __cplusplus
}
#endif

#endif
