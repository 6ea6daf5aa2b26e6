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

$functions
