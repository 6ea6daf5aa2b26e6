/*
 * sf_kins.c: joints (mm, degree) and world coordinates of "tilting table BC" as LinuxCNC counts them, in plain C99.
 * Made by symfive 0.1.0; change the model, not this file. model sha256 74a1813ac4abe34ed5aac8b3a152445812b6762ed1acfd3276113623cfb8024c
 *
 * World x, y, z: the controlled point in the workpiece frame, with the tool length that LinuxCNC adds along z; every other
 * world coordinate is its axis' own position. Joints in the order X Y Z B C. sf_world_of_axes and sf_axes_of_world are
 * the other kind of programming: every world coordinate is its axis' own position.
 */
#include "sf.c"

#define SF_JOINTS 5
#define SF_WORLD 9 /* x y z a b c u v w */
#define SF_DEGREE 0.017453292519943295 /* rad */

int sf_world(const double joints[SF_JOINTS], double tool_offset, const double p[SF_P_SIZE],
             double world[SF_WORLD]);
int sf_joints(const double world[SF_WORLD], double tool_offset, const double p[SF_P_SIZE],
              double joints[SF_JOINTS]);
void sf_world_of_axes(const double joints[SF_JOINTS], double world[SF_WORLD]);
void sf_axes_of_world(const double world[SF_WORLD], double joints[SF_JOINTS]);

int sf_world(const double joints[SF_JOINTS], double tool_offset, const double p[SF_P_SIZE],
             double world[SF_WORLD])
{
    const double tool[3] = { 0.0, 0.0, -tool_offset };
    double q[SF_AXES];
    double position[3];
    double direction[3];
    int status;

    q[1] = joints[0];
    q[0] = joints[1];
    q[4] = joints[2];
    q[2] = joints[3] * SF_DEGREE;
    q[3] = joints[4] * SF_DEGREE;
    status = sf_forward(q, tool, p, position, direction);
    if (status == SF_OK) {
        world[3] = 0.0;
        world[4] = joints[3];
        world[5] = joints[4];
        world[6] = 0.0;
        world[7] = 0.0;
        world[8] = 0.0;
        world[0] = position[0];
        world[1] = position[1];
        world[2] = position[2] + tool_offset;
    }
    return status;
}

int sf_joints(const double world[SF_WORLD], double tool_offset, const double p[SF_P_SIZE],
              double joints[SF_JOINTS])
{
    const double tool[3] = { 0.0, 0.0, -tool_offset };
    const double target[3] = { world[0], world[1], world[2] - tool_offset };
    double q[SF_AXES];
    int status;

    q[1] = world[0];
    q[0] = world[1];
    q[4] = world[2];
    q[2] = world[4] * SF_DEGREE;
    q[3] = world[5] * SF_DEGREE;
    status = sf_inverse(target, tool, p, q);
    if (status == SF_OK) {
        joints[0] = q[1];
        joints[1] = q[0];
        joints[2] = q[4];
        joints[3] = world[4];
        joints[4] = world[5];
    }
    return status;
}

void sf_world_of_axes(const double joints[SF_JOINTS], double world[SF_WORLD])
{
    world[0] = joints[0];
    world[1] = joints[1];
    world[2] = joints[2];
    world[3] = 0.0;
    world[4] = joints[3];
    world[5] = joints[4];
    world[6] = 0.0;
    world[7] = 0.0;
    world[8] = 0.0;
}

void sf_axes_of_world(const double world[SF_WORLD], double joints[SF_JOINTS])
{
    joints[0] = world[0];
    joints[1] = world[1];
    joints[2] = world[2];
    joints[3] = world[4];
    joints[4] = world[5];
}
