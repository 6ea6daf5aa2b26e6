component ${prefix}kins "Kinematics of $comp_machine with its identified errors, one pin each";
description """
Made by symfive $version; change the model, not this file. model sha256 $digest

Structure $structure, joints in the order $joints; joint and world coordinates in mm and degree.
A pin per parameter (um, urad as in ${prefix}.h) begins with its identified value; all at 0 is the machine without errors.
Values set before the control starts, or while words are the axes' own positions, hold at once. Otherwise a pin that changes is
followed at the speed of pin ramp, 20 um or urad a second, 0: not at all. Pin following is true meanwhile. A pin that is not a number, infinite or beyond 1e6 is not followed:
pin fault is true, and the value before remains. Where the tool length is not finite, no pose is found.
Pin tool-offset is the tool length: net it to motion.tooloffset.z. Rotary axes turn about their directions in ${prefix}.h; the
stock trunnion kinematics without conventional-directions turn theirs against ISO 841.

Where motion.switchkins-type is 0, x y z of a program are the tool centre point in the workpiece frame; where it is 1, they
are the axes' own positions. Change a tool length (G43) while it is 1: a tilted tool's point would jump otherwise.

The function check works through both directions once a cycle, for tests: check-world-0 to check-world-5 (x y z a b c) to
check-joint-0 ... and back to check-back-0 ...; check-status is 0 where both were found.
""";
pin in float check_world-#[6] "x y z a b c of the test";
pin out float check_joint-#[$axes] "joints of the test";
pin out float check_back-#[6] "world coordinates of these joints";
pin out s32 check_status "0: done; -1: no inverse, -2: no forward kinematics";
function check fp;
option singleton yes;
option extra_setup yes;
license "GPL-2.0-or-later"; // for LinuxCNC's kinematics.h; ${prefix}.c and ${prefix}_kins.c are free of it
;;
#include "kinematics.h"
#include "rtapi_math.h"
#include "${prefix}_kins.c"

#define LARGEST_PIN 1.0e6   /* um or urad */
#define LONGEST_CYCLE 0.01 /* s: what a pause of the control adds to a ramp */

struct pins {
    hal_float_t *tool_offset;
    hal_float_t *ramp;
    hal_bit_t *following;
    hal_bit_t *fault;
    hal_float_t *p[${PREFIX}_P_SIZE];
};
static struct pins *pins = 0;
static double in_use[${PREFIX}_P_SIZE]; /* the values that the kinematics work with */
static long long last_time = 0;     /* ns; 0 before the first call */
static int programmed_axes = 0; /* 0: words are the tool centre point, 1: words are positions of the axes */

/* Brings the values in use nearer to the pins, as far as the time since the last call allows, or `at_once`. */
static void follow_pins(int at_once)
{
    const long long now = rtapi_get_time();
    const double passed = (double)(now - last_time) * 1.0e-9;
    const double seconds = (passed < LONGEST_CYCLE) ? passed : LONGEST_CYCLE;
    const double speed = *pins->ramp;
    const double most = ((speed > 0.0) && (speed <= LARGEST_PIN) && (seconds > 0.0)) ? (speed * seconds) : 0.0;
    int following = 0;
    int fault = 0;
    int i;

    for (i = 0; i < ${PREFIX}_PARAMETERS; ++i) {
        const double wanted = *pins->p[i];
        const double missing = wanted - in_use[i];

        if (!(fabs(wanted) <= LARGEST_PIN)) { /* true for what is not a number, too */
            fault = 1;
        } else if (at_once || (fabs(missing) <= most)) {
            in_use[i] = wanted;
        } else {
            in_use[i] += (missing > 0.0) ? most : -most;
            following = 1;
        }
    }
    *pins->following = following;
    *pins->fault = fault;
    last_time = now;
}

EXTRA_SETUP()
{
    static const char *const names[${PREFIX}_P_SIZE] = {
$pin_names
    };
    int result = 0;
    int i;

    (void)prefix;
    (void)extra_arg;
    pins = hal_malloc(sizeof(*pins));
    if (pins == 0) {
        return -1;
    }
    ${prefix}_parameters(in_use);
    result = hal_pin_float_newf(HAL_IN, &pins->tool_offset, comp_id, "${prefix}kins.tool-offset");
    result = (result == 0) ? hal_pin_float_newf(HAL_IN, &pins->ramp, comp_id, "${prefix}kins.ramp") : result;
    result = (result == 0) ? hal_pin_bit_newf(HAL_OUT, &pins->following, comp_id, "${prefix}kins.following") : result;
    result = (result == 0) ? hal_pin_bit_newf(HAL_OUT, &pins->fault, comp_id, "${prefix}kins.fault") : result;
    if (result == 0) {
        *pins->ramp = 20.0;
    }
    for (i = 0; (i < ${PREFIX}_PARAMETERS) && (result == 0); ++i) {
        result = hal_pin_float_newf(HAL_IN, &pins->p[i], comp_id, "${prefix}kins.%s", names[i]);
        if (result == 0) {
            *pins->p[i] = in_use[i];
        }
    }
    return result;
}

EXPORT_SYMBOL(kinematicsSwitchable);
EXPORT_SYMBOL(kinematicsSwitch);
EXPORT_SYMBOL(kinematicsType);
EXPORT_SYMBOL(kinematicsForward);
EXPORT_SYMBOL(kinematicsInverse);

int kinematicsSwitchable(void)
{
    return 1;
}

int kinematicsSwitch(int type)
{
    const int known = (type == 0) || (type == 1);

    if (known) {
        programmed_axes = type;
    }
    return known ? 0 : -1;
}

KINEMATICS_TYPE kinematicsType(void)
{
    return KINEMATICS_BOTH;
}

int kinematicsForward(const double *joints, EmcPose *pose, const KINEMATICS_FORWARD_FLAGS *fflags,
                      KINEMATICS_INVERSE_FLAGS *iflags)
{
    double world[${PREFIX}_WORLD];
    int status = ${PREFIX}_OK;

    (void)fflags;
    (void)iflags;
    follow_pins((last_time == 0) || (programmed_axes != 0)); /* the joints do not depend on them then */
    if (programmed_axes != 0) {
        ${prefix}_world_of_axes(joints, world);
    } else {
        status = ${prefix}_world(joints, *pins->tool_offset, in_use, world);
    }
    if (status != ${PREFIX}_OK) {
        return -1; /* the pose stays as it is */
    }
    pose->tran.x = world[0];
    pose->tran.y = world[1];
    pose->tran.z = world[2];
    pose->a = world[3];
    pose->b = world[4];
    pose->c = world[5];
    pose->u = world[6];
    pose->v = world[7];
    pose->w = world[8];
    return 0;
}

int kinematicsInverse(const EmcPose *pose, double *joints, const KINEMATICS_INVERSE_FLAGS *iflags,
                      KINEMATICS_FORWARD_FLAGS *fflags)
{
    const double world[${PREFIX}_WORLD] = { pose->tran.x, pose->tran.y, pose->tran.z, pose->a, pose->b, pose->c,
                                     pose->u, pose->v, pose->w };
    int status = ${PREFIX}_OK;

    (void)iflags;
    (void)fflags;
    follow_pins((last_time == 0) || (programmed_axes != 0));
    if (programmed_axes != 0) {
        ${prefix}_axes_of_world(world, joints);
    } else {
        status = ${prefix}_joints(world, *pins->tool_offset, in_use, joints);
    }
    return (status == ${PREFIX}_OK) ? 0 : -1;
}

FUNCTION(check)
{
    EmcPose pose = { { check_world(0), check_world(1), check_world(2) }, check_world(3), check_world(4), check_world(5), 0.0, 0.0, 0.0 };
    double joints[${PREFIX}_JOINTS] = { 0.0 };
    int i;

    check_status = kinematicsInverse(&pose, joints, 0, 0);
    for (i = 0; i < ${PREFIX}_JOINTS; ++i) {
        check_joint(i) = joints[i];
    }
    if (kinematicsForward(joints, &pose, 0, 0) != 0) {
        check_status = -2;
    }
    check_back(0) = pose.tran.x;
    check_back(1) = pose.tran.y;
    check_back(2) = pose.tran.z;
    check_back(3) = pose.a;
    check_back(4) = pose.b;
    check_back(5) = pose.c;
}
