/*
 * ${prefix}_batch.h: the real tool's point and its parameter Jacobian for many poses, with the vector types of GCC and Clang.
 *
 * Made by symfive $version from model sha256 $digest.
 * Compile with -std=gnu99 -O2 -march=native, never with -ffast-math. Double precision. Units, signs and orders as in $prefix.h.
 *
 * Poses stand in tiles of ${PREFIX}_LANES: element i of pose n is at [(n / LANES) * size * LANES + i * LANES + n % LANES]. Every
 * array begins at a multiple of ${PREFIX}_ALIGNMENT bytes, better of 64; unused lanes of the last tile must hold finite numbers.
 * Angles up to 1e5 rad.
 *
 * ${PREFIX}_LANES is how many doubles a register of the instruction set holds: 8 with AVX-512, 4 with AVX2, 2 with SSE2 or NEON.
 * Files that are compiled for other instructions than ${prefix}_batch.c define it alike (-D${PREFIX}_LANES=8). The link names end in
 * it (${prefix}_batch_forward_8), so that a program whose tiles have another size than the kernel's does not link.
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
$lanes
#endif
#define ${PREFIX}_ALIGNMENT (8 * ${PREFIX}_LANES)
#define ${PREFIX}_BATCH_AXES $axes
#define ${PREFIX}_BATCH_PARAMETERS $parameters
#define ${PREFIX}_CONSTANTS $constants
#define ${PREFIX}_NORMAL ($parameters + 1)
#define ${PREFIX}_WORK ((size_t)$vectors * ${PREFIX}_LANES) /* doubles that the information matrix works in */

#define ${PREFIX}_LINK_NAME(name, lanes) name##_##lanes
#define ${PREFIX}_LINKED(name, lanes) ${PREFIX}_LINK_NAME(name, lanes)
#define ${prefix}_batch_prepare ${PREFIX}_LINKED(${prefix}_batch_prepare, ${PREFIX}_LANES)
#define ${prefix}_batch_forward ${PREFIX}_LINKED(${prefix}_batch_forward, ${PREFIX}_LANES)
#define ${prefix}_batch_jacobian ${PREFIX}_LINKED(${prefix}_batch_jacobian, ${PREFIX}_LANES)
#define ${prefix}_batch_information ${PREFIX}_LINKED(${prefix}_batch_information, ${PREFIX}_LANES)
#define ${prefix}_batch_leverage ${PREFIX}_LINKED(${prefix}_batch_leverage, ${PREFIX}_LANES)
#define ${prefix}_batch_predict ${PREFIX}_LINKED(${prefix}_batch_predict, ${PREFIX}_LANES)

/* Lanes that this library was compiled with, and the sha256 of its model. */
size_t ${prefix}_batch_lanes(void);
const char *${prefix}_batch_model(void);

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
