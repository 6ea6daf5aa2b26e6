/*
 * $prefix.c: see $prefix.h. Made by symfive $version; change the model, not this file.
 * model sha256 $digest
 */
#include <math.h>
#include "$prefix.h"

#ifdef ${PREFIX}_FLOAT
$float_macros
#else
$double_macros
#endif

/* Whether all are finite and no larger than `most`. */
static int sound(int count, const ${prefix}_real *x, ${prefix}_real most)
{
    int good = 1;
    int i;

    for (i = 0; i < count; ++i) {
        if (!(${PREFIX}_FABS(x[i]) <= most)) { /* true for what is not a number, too */
            good = 0;
        }
    }
    return good;
}

static int sound_pose(const ${prefix}_real q[${PREFIX}_AXES], const ${prefix}_real tool[3])
{
    const ${prefix}_real farthest = (${prefix}_real)${PREFIX}_FARTHEST;

    return ((sound(${PREFIX}_AXES, q, farthest) != 0) && (sound(3, tool, farthest) != 0)) ? 1 : 0;
}

static int sound_parameters(const ${prefix}_real p[${PREFIX}_P_SIZE])
{
    return sound(${PREFIX}_P_SIZE, p, (${prefix}_real)${PREFIX}_LARGEST);
}

$functions
