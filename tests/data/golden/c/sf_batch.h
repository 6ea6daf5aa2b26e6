/*
 * sf_batch.h: the real tool's point and its parameter Jacobian for many poses, with the vector types of GCC and Clang.
 *
 * Made by symfive 0.1.0 from model sha256 74a1813ac4abe34ed5aac8b3a152445812b6762ed1acfd3276113623cfb8024c.
 * Compile with -std=gnu99 -O2 -march=native, never with -ffast-math. Double precision. Units, signs and orders as in sf.h.
 *
 * Poses stand in tiles of SF_LANES: element i of pose n is at [(n / LANES) * size * LANES + i * LANES + n % LANES]. Every
 * array begins at a multiple of SF_ALIGNMENT bytes, better of 64; unused lanes of the last tile must hold finite numbers.
 * Angles up to 1e5 rad.
 *
 * SF_LANES is how many doubles a register of the instruction set holds: 8 with AVX-512, 4 with AVX2, 2 with SSE2 or NEON.
 * Files that are compiled for other instructions than sf_batch.c define it alike (-DSF_LANES=8). The link names end in
 * it (sf_batch_forward_8), so that a program whose tiles have another size than the kernel's does not link.
 *
 * Operations a pose for point and Jacobian: 182 (what the parameters alone decide is done once, in prepare).
 */
#ifndef SF_BATCH_H
#define SF_BATCH_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

#ifndef SF_LANES
#if defined(__AVX512F__)
#define SF_LANES 8
#elif defined(__AVX2__)
#define SF_LANES 4
#elif defined(__SSE2__) || defined(__aarch64__) || defined(__VSX__)
#define SF_LANES 2
#else
#define SF_LANES 1
#endif
#endif
#define SF_ALIGNMENT (8 * SF_LANES)
#define SF_BATCH_AXES 5
#define SF_BATCH_PARAMETERS 9
#define SF_CONSTANTS 17
#define SF_NORMAL (9 + 1)
#define SF_WORK ((size_t)672 * SF_LANES) /* doubles that the information matrix works in */

#define SF_LINK_NAME(name, lanes) name##_##lanes
#define SF_LINKED(name, lanes) SF_LINK_NAME(name, lanes)
#define sf_batch_prepare SF_LINKED(sf_batch_prepare, SF_LANES)
#define sf_batch_forward SF_LINKED(sf_batch_forward, SF_LANES)
#define sf_batch_jacobian SF_LINKED(sf_batch_jacobian, SF_LANES)
#define sf_batch_information SF_LINKED(sf_batch_information, SF_LANES)
#define sf_batch_leverage SF_LINKED(sf_batch_leverage, SF_LANES)
#define sf_batch_predict SF_LINKED(sf_batch_predict, SF_LANES)

/* Lanes that this library was compiled with, and the sha256 of its model. */
size_t sf_batch_lanes(void);
const char *sf_batch_model(void);

/* What does not depend on the pose: c[SF_CONSTANTS] from tool[3] and p[9]. */
void sf_batch_prepare(const double *tool, const double *p, double *c);

/* The point of every pose: position, 3 a pose. */
void sf_batch_forward(size_t tiles, const double *q, const double *c, double *position);

/* The point and its Jacobian, column by column: 3 * 9 a pose. `stream`: 1 writes past the caches; 0 through them, each
 * line fetched before it is written. Which is faster for results larger than the caches depends on the processor. */
void sf_batch_jacobian(size_t tiles, const double *q, const double *c, double *position, double *by_p, int stream);

/*
 * Adds to `normal`, a square matrix of SF_NORMAL rows, the sums over all poses of
 *   J'J   J'r
 *   r'J   r'r     with r = target - point (3 a pose, in tiles),
 * without ever storing J. `work`: SF_WORK doubles.
 */
void sf_batch_information(size_t poses, const double *q, const double *c, const double *target, double *normal,
                          double *work);

/*
 * J M J' of every pose for a covariance M = F F' of the parameters, 6 a pose in tiles: xx, xy, xz, yy, yz, zz. Its trace and its
 * determinant are what an exchange of poses asks for. `factor`: F, row by row, 9 rows of `rank` numbers; `work`:
 * SF_WORK doubles. J never leaves the tile.
 */
void sf_batch_leverage(size_t tiles, const double *q, const double *c, const double *factor, size_t rank,
                       double *leverage, double *work);

/* First-order prediction, 3 a pose in tiles: point + J d for a step d of the parameters; J never leaves the tile. */
void sf_batch_predict(size_t tiles, const double *q, const double *c, const double *d, double *predicted);

#ifdef __cplusplus
}
#endif

#endif
