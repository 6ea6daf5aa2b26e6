/*
 * ${prefix}_kins.c: joints (mm, degree) and world coordinates of "$machine" as LinuxCNC counts them, in plain C99.
 * Made by symfive $version; change the model, not this file. model sha256 $digest
 *
 * World x, y, z: the controlled point in the workpiece frame, with the tool length that LinuxCNC adds along z; every other
 * world coordinate is its axis' own position. Joints in the order $joints. ${prefix}_world_of_axes and ${prefix}_axes_of_world are
 * the other kind of programming: every world coordinate is its axis' own position.
 */
#include "${prefix}.c"

#define ${PREFIX}_JOINTS $axes
#define ${PREFIX}_WORLD 9 /* x y z a b c u v w */
#define ${PREFIX}_DEGREE 0.017453292519943295 /* rad */

int ${prefix}_world(const double joints[${PREFIX}_JOINTS], double tool_offset, const double p[${PREFIX}_P_SIZE],
             double world[${PREFIX}_WORLD]);
int ${prefix}_joints(const double world[${PREFIX}_WORLD], double tool_offset, const double p[${PREFIX}_P_SIZE],
              double joints[${PREFIX}_JOINTS]);
void ${prefix}_world_of_axes(const double joints[${PREFIX}_JOINTS], double world[${PREFIX}_WORLD]);
void ${prefix}_axes_of_world(const double world[${PREFIX}_WORLD], double joints[${PREFIX}_JOINTS]);

int ${prefix}_world(const double joints[${PREFIX}_JOINTS], double tool_offset, const double p[${PREFIX}_P_SIZE],
             double world[${PREFIX}_WORLD])
{
    const double tool[3] = { 0.0, 0.0, -tool_offset };
    double q[${PREFIX}_AXES];
    double position[3];
    double direction[3];
    int status;

$from_joints
    status = ${prefix}_forward(q, tool, p, position, direction);
    if (status == ${PREFIX}_OK) {
$to_world
        world[0] = position[0];
        world[1] = position[1];
        world[2] = position[2] + tool_offset;
    }
    return status;
}

int ${prefix}_joints(const double world[${PREFIX}_WORLD], double tool_offset, const double p[${PREFIX}_P_SIZE],
              double joints[${PREFIX}_JOINTS])
{
    const double tool[3] = { 0.0, 0.0, -tool_offset };
    const double target[3] = { world[0], world[1], world[2] - tool_offset };
    double q[${PREFIX}_AXES];
    int status;

$from_world
    status = ${prefix}_inverse(target, tool, p, q);
    if (status == ${PREFIX}_OK) {
$to_joints
    }
    return status;
}

void ${prefix}_world_of_axes(const double joints[${PREFIX}_JOINTS], double world[${PREFIX}_WORLD])
{
$axes_to_world
}

void ${prefix}_axes_of_world(const double world[${PREFIX}_WORLD], double joints[${PREFIX}_JOINTS])
{
$world_to_axes
}
