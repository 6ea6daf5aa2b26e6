/*
 * The batch kernel called from C as a program would: rows into tiles by the header's layout, every function once, rows back.
 *
 *     driver IN OUT      doubles of this processor
 *     IN:  poses, rank, tool[3], p, step, factor (parameters x rank), q (poses x axes), target (poses x 3)
 *     OUT: lanes, points, points and J through the caches, the same past them, predicted, information, leverage (poses x 6)
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include "sf_batch.h"

#define AXES SF_BATCH_AXES
#define PARAMETERS SF_BATCH_PARAMETERS

static double *room(size_t count)
{
    char *const bytes = calloc(count * sizeof(double) + SF_ALIGNMENT, 1);

    if (bytes == NULL) {
        exit(3);
    }
    return (double *)(bytes + (SF_ALIGNMENT - (uintptr_t)bytes % SF_ALIGNMENT) % SF_ALIGNMENT);
}

static double *taken(FILE *in, size_t count)
{
    double *const values = room(count);

    if (fread(values, sizeof(double), count, in) != count) {
        exit(4);
    }
    return values;
}

static size_t place(size_t pose, size_t i, size_t size)
{
    return (pose / SF_LANES) * size * SF_LANES + i * SF_LANES + pose % SF_LANES;
}

static double *in_tiles(const double *rows, size_t poses, size_t size)
{
    const size_t padded = (poses + SF_LANES - 1) / SF_LANES * SF_LANES;
    double *const tiles = room(padded * size);

    for (size_t n = 0; n < padded; ++n) {
        for (size_t i = 0; i < size; ++i) {
            tiles[place(n, i, size)] = rows[(n < poses ? n : 0) * size + i];
        }
    }
    return tiles;
}

static void given(FILE *out, const double *tiles, size_t poses, size_t size)
{
    for (size_t n = 0; n < poses; ++n) {
        for (size_t i = 0; i < size; ++i) {
            fwrite(&tiles[place(n, i, size)], sizeof(double), 1, out);
        }
    }
}

int main(int count, char **names)
{
    FILE *const in = count == 3 ? fopen(names[1], "rb") : NULL, *const out = count == 3 ? fopen(names[2], "wb") : NULL;

    if (in == NULL || out == NULL) {
        return 2;
    }
    const double *const sizes = taken(in, 2);
    const size_t poses = (size_t)sizes[0], rank = (size_t)sizes[1], tiles = (poses + SF_LANES - 1) / SF_LANES;
    const double *const tool = taken(in, 3), *const p = taken(in, PARAMETERS), *const step = taken(in, PARAMETERS);
    const double *const factor = taken(in, PARAMETERS * rank);
    const double *const q = in_tiles(taken(in, poses * AXES), poses, AXES);
    const double *const target = in_tiles(taken(in, poses * 3), poses, 3);
    double *const c = room(SF_CONSTANTS), *const work = room(SF_WORK), *const normal = room(SF_NORMAL * SF_NORMAL);
    double *const points = room(tiles * 3 * SF_LANES), *const by_p = room(tiles * 3 * PARAMETERS * SF_LANES);
    double *const leverage = room(tiles * 6 * SF_LANES);
    const double lanes = (double)sf_batch_lanes();

    fwrite(&lanes, sizeof(double), 1, out);
    sf_batch_prepare(tool, p, c);
    sf_batch_forward(tiles, q, c, points);
    given(out, points, poses, 3);
    for (int stream = 0; stream <= 1; ++stream) {
        sf_batch_jacobian(tiles, q, c, points, by_p, stream);
        given(out, points, poses, 3);
        given(out, by_p, poses, 3 * PARAMETERS);
    }
    sf_batch_predict(tiles, q, c, step, points);
    given(out, points, poses, 3);
    sf_batch_information(poses, q, c, target, normal, work);
    fwrite(normal, sizeof(double), SF_NORMAL * SF_NORMAL, out);
    sf_batch_leverage(tiles, q, c, factor, rank, leverage, work);
    given(out, leverage, poses, 6);
    return fclose(out) == 0 ? 0 : 5;
}
