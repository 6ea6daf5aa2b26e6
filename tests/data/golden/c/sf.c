/*
 * sf.c: see sf.h. Made by symfive 0.1.0; change the model, not this file.
 * model sha256 74a1813ac4abe34ed5aac8b3a152445812b6762ed1acfd3276113623cfb8024c
 */
#include <math.h>
#include "sf.h"

#ifdef SF_FLOAT
#define SF_SIN sinf
#define SF_COS cosf
#define SF_ATAN2 atan2f
#define SF_SQRT sqrtf
#define SF_FABS fabsf
#define SF_FLOOR floorf
#define SF_LAST_TURN ((sf_real)1.0e-5)
#define SF_SLACK ((sf_real)1.0e-6)
#define SF_NARROWEST ((sf_real)1.0e-3)
#else
#define SF_SIN sin
#define SF_COS cos
#define SF_ATAN2 atan2
#define SF_SQRT sqrt
#define SF_FABS fabs
#define SF_FLOOR floor
#define SF_LAST_TURN ((sf_real)1.0e-12)
#define SF_SLACK ((sf_real)1.0e-12)
#define SF_NARROWEST ((sf_real)1.0e-6)
#endif

/* Whether all are finite and no larger than `most`. */
static int sound(int count, const sf_real *x, sf_real most)
{
    int good = 1;
    int i;

    for (i = 0; i < count; ++i) {
        if (!(SF_FABS(x[i]) <= most)) { /* true for what is not a number, too */
            good = 0;
        }
    }
    return good;
}

static int sound_pose(const sf_real q[SF_AXES], const sf_real tool[3])
{
    const sf_real farthest = (sf_real)SF_FARTHEST;

    return ((sound(SF_AXES, q, farthest) != 0) && (sound(3, tool, farthest) != 0)) ? 1 : 0;
}

static int sound_parameters(const sf_real p[SF_P_SIZE])
{
    return sound(SF_P_SIZE, p, (sf_real)SF_LARGEST);
}

void sf_parameters(sf_real p[SF_P_SIZE])
{
    p[0] = (sf_real)-20.0; /* EC0X, urad */
    p[1] = (sf_real)-13.0; /* EX0B, um */
    p[2] = (sf_real)-6.0; /* EA0B, urad */
    p[3] = (sf_real)1.0; /* EX0C, um */
    p[4] = (sf_real)8.0; /* EA0C, urad */
    p[5] = (sf_real)15.0; /* EXC.cos1, um */
    p[6] = (sf_real)22.0; /* EXC.sin1, um */
    p[7] = (sf_real)29.0; /* EXC.cos2, um */
    p[8] = (sf_real)36.0; /* EXC.sin2, um */
}

const char *sf_model(void)
{
    return SF_MODEL;
}

const char *sf_parameter_name(int index)
{
    static const char *const names[SF_P_SIZE] = {
        "EC0X",
        "EX0B",
        "EA0B",
        "EX0C",
        "EA0C",
        "EXC.cos1",
        "EXC.sin1",
        "EXC.cos2",
        "EXC.sin2"
    };

    return ((index >= 0) && (index < SF_PARAMETERS)) ? names[index] : "";
}

int sf_error(const sf_real q[SF_AXES], const sf_real tool[3],
             const sf_real p[SF_P_SIZE], sf_real error[3], sf_real tilt[3])
{
    sf_real position[3];
    sf_real direction[3];
    sf_real nominal_position[3];
    sf_real nominal_direction[3];
    const int status = sf_forward(q, tool, p, position, direction);
    int i;

    (void)sf_nominal(q, tool, nominal_position, nominal_direction);
    for (i = 0; i < 3; ++i) {
        error[i] = position[i] - nominal_position[i];
        tilt[i] = direction[i] - nominal_direction[i];
    }
    return status;
}

int sf_forward(const sf_real q[SF_AXES], const sf_real tool[3], const sf_real p[SF_P_SIZE], sf_real position[3],
               sf_real direction[3])
{
    int given = sound_pose(q, tool);

    if (sound_parameters(p) == 0) {
        given = 0;
    }

    const sf_real p0 = p[0];
    const sf_real p1 = p[1];
    const sf_real p2 = p[2];
    const sf_real p3 = p[3];
    const sf_real p4 = p[4];
    const sf_real p5 = p[5];
    const sf_real p6 = p[6];
    const sf_real p7 = p[7];
    const sf_real p8 = p[8];
    const sf_real q0 = q[0];
    const sf_real q1 = q[1];
    const sf_real q2 = q[2];
    const sf_real q3 = q[3];
    const sf_real q4 = q[4];
    const sf_real tool0 = tool[0];
    const sf_real tool1 = tool[1];
    const sf_real tool2 = tool[2];
    const sf_real k0 = (sf_real)(1e-06);
    const sf_real k1 = (sf_real)(0.001);
    const sf_real t0 = SF_COS(q3);
    const sf_real t1 = SF_COS(q2);
    const sf_real t2 = k0 * p4;
    const sf_real t3 = SF_SIN(t2);
    const sf_real t4 = SF_SIN(q3);
    const sf_real t5 = t3 * t4;
    const sf_real t6 = SF_SIN(q2);
    const sf_real t7 = (t0 * t1) + (t5 * t6);
    const sf_real t8 = k0 * p2;
    const sf_real t9 = SF_SIN(t8);
    const sf_real t10 = t6 * t9;
    const sf_real t11 = -(t0 * t10);
    const sf_real t12 = SF_COS(t2);
    const sf_real t13 = t4 * t12;
    const sf_real t14 = SF_COS(t8);
    const sf_real t15 = t1 * t9;
    const sf_real t16 = (t11 - (t13 * t14)) + (t5 * t15);
    const sf_real t17 = -(t9 * t13);
    const sf_real t18 = t6 * t14;
    const sf_real t19 = t1 * t14;
    const sf_real t20 = (t17 + (t0 * t18)) - (t5 * t19);
    direction[0] = t20;
    const sf_real t21 = k0 * p0;
    const sf_real t22 = SF_COS(t21);
    const sf_real t23 = t22 * q1;
    const sf_real t24 = SF_SIN(t21);
    const sf_real t25 = q1 * t24;
    const sf_real t26 = ((t0 * (k1 * p5)) + (t4 * (k1 * p6))) + ((k1 * p7) * ((t0 * t0) - (t4 * t4)));
    const sf_real t27 = t0 * t4;
    const sf_real t28 = (k1 * p3) + (t26 + ((t27 + t27) * (k1 * p8)));
    const sf_real t29 = k1 * p1;
    const sf_real t30 = ((t7 * t23) + (t16 * t25)) - ((t0 * t28) + (t7 * t29));
    position[0] = (((t7 * tool0) + (t16 * tool1)) + (t20 * tool2)) + ((t20 * q4) + (t30 + (t16 * q0)));
    const sf_real t31 = t0 * t3;
    const sf_real t32 = -(t6 * t31);
    const sf_real t33 = t32 + (t1 * t4);
    const sf_real t34 = t0 * t12;
    const sf_real t35 = ((t14 * t34) - (t4 * t10)) - (t15 * t31);
    const sf_real t36 = ((t4 * t18) + (t9 * t34)) + (t19 * t31);
    direction[1] = t36;
    const sf_real t37 = -(t4 * t28);
    const sf_real t38 = (t37 - (t29 * t33)) + ((t23 * t33) + (t25 * t35));
    position[1] = (((tool0 * t33) + (tool1 * t35)) + (tool2 * t36)) + ((q4 * t36) + (t38 + (q0 * t35)));
    const sf_real t39 = t6 * t12;
    const sf_real t40 = -(tool0 * t39);
    const sf_real t41 = (t3 * t14) + (t12 * t15);
    const sf_real t42 = (t12 * t19) - (t3 * t9);
    direction[2] = t42;
    const sf_real t43 = (((t25 * t41) + (t23 * t39)) - (t29 * t39)) + (q0 * t41);
    position[2] = ((t40 - (tool1 * t41)) + (tool2 * t42)) + ((q4 * t42) - t43);

    return ((given != 0) && (sound(3, position, (sf_real)SF_LARGEST) != 0) && (sound(3, direction, (sf_real)SF_LARGEST) != 0)) ? SF_OK : SF_INVALID;
}

int sf_nominal(const sf_real q[SF_AXES], const sf_real tool[3], sf_real position[3], sf_real direction[3])
{
    int given = sound_pose(q, tool);

    const sf_real q0 = q[0];
    const sf_real q1 = q[1];
    const sf_real q2 = q[2];
    const sf_real q3 = q[3];
    const sf_real q4 = q[4];
    const sf_real tool0 = tool[0];
    const sf_real tool1 = tool[1];
    const sf_real tool2 = tool[2];
    const sf_real t0 = SF_COS(q3);
    const sf_real t1 = SF_COS(q2);
    direction[2] = t1;
    const sf_real t2 = t0 * t1;
    const sf_real t3 = SF_SIN(q3);
    const sf_real t4 = SF_SIN(q2);
    const sf_real t5 = t0 * t4;
    direction[0] = t5;
    position[0] = (((t2 * tool0) - (t3 * tool1)) + (tool2 * t5)) + (((t2 * q1) - (t3 * q0)) + (q4 * t5));
    const sf_real t6 = t1 * t3;
    const sf_real t7 = t3 * t4;
    direction[1] = t7;
    position[1] = (((t0 * tool1) + (tool0 * t6)) + (tool2 * t7)) + ((q4 * t7) + ((t0 * q0) + (q1 * t6)));
    position[2] = ((t1 * tool2) - (t4 * tool0)) + ((t1 * q4) - (t4 * q1));

    return ((given != 0) && (sound(3, position, (sf_real)SF_LARGEST) != 0) && (sound(3, direction, (sf_real)SF_LARGEST) != 0)) ? SF_OK : SF_INVALID;
}

int sf_axis_jacobian(const sf_real q[SF_AXES], const sf_real tool[3], const sf_real p[SF_P_SIZE], sf_real
                     by_q[3 * SF_AXES], sf_real direction_by_q[3 * SF_AXES])
{
    int given = sound_pose(q, tool);

    if (sound_parameters(p) == 0) {
        given = 0;
    }

    const sf_real p0 = p[0];
    const sf_real p1 = p[1];
    const sf_real p2 = p[2];
    const sf_real p3 = p[3];
    const sf_real p4 = p[4];
    const sf_real p5 = p[5];
    const sf_real p6 = p[6];
    const sf_real p7 = p[7];
    const sf_real p8 = p[8];
    const sf_real q0 = q[0];
    const sf_real q1 = q[1];
    const sf_real q2 = q[2];
    const sf_real q3 = q[3];
    const sf_real q4 = q[4];
    const sf_real tool0 = tool[0];
    const sf_real tool1 = tool[1];
    const sf_real tool2 = tool[2];
    const sf_real k0 = (sf_real)(1e-06);
    const sf_real k1 = (sf_real)(0.001);
    const sf_real k2 = (sf_real)(0.0);
    const sf_real t0 = SF_COS(q3);
    const sf_real t1 = SF_SIN(q2);
    const sf_real t2 = k0 * p2;
    const sf_real t3 = SF_SIN(t2);
    const sf_real t4 = t1 * t3;
    const sf_real t5 = -(t0 * t4);
    const sf_real t6 = SF_SIN(q3);
    const sf_real t7 = k0 * p4;
    const sf_real t8 = SF_COS(t7);
    const sf_real t9 = t6 * t8;
    const sf_real t10 = SF_COS(t2);
    const sf_real t11 = SF_SIN(t7);
    const sf_real t12 = t11 * t6;
    const sf_real t13 = SF_COS(q2);
    const sf_real t14 = t13 * t3;
    const sf_real t15 = (t5 - (t9 * t10)) + (t12 * t14);
    by_q[0] = t15;
    const sf_real t16 = t0 * t8;
    const sf_real t17 = t0 * t11;
    const sf_real t18 = ((t10 * t16) - (t6 * t4)) - (t14 * t17);
    by_q[1] = t18;
    const sf_real t19 = (t11 * t10) + (t8 * t14);
    by_q[2] = -t19;
    const sf_real t20 = (t0 * t13) + (t12 * t1);
    const sf_real t21 = k0 * p0;
    const sf_real t22 = SF_COS(t21);
    const sf_real t23 = SF_SIN(t21);
    by_q[3] = (t20 * t22) + (t15 * t23);
    const sf_real t24 = -(t1 * t17);
    const sf_real t25 = t24 + (t13 * t6);
    by_q[4] = (t22 * t25) + (t23 * t18);
    const sf_real t26 = t1 * t8;
    const sf_real t27 = -(t22 * t26);
    by_q[5] = t27 - (t23 * t19);
    const sf_real t28 = -(tool0 * t26);
    const sf_real t29 = t13 * t10;
    const sf_real t30 = (t8 * t29) - (t11 * t3);
    by_q[14] = t30;
    const sf_real t31 = q1 * t23;
    const sf_real t32 = t22 * q1;
    const sf_real t33 = k1 * p1;
    const sf_real t34 = (((t31 * t19) + (t32 * t26)) - (t33 * t26)) + (q0 * t19);
    const sf_real t35 = ((t28 - (tool1 * t19)) + (tool2 * t30)) + ((q4 * t30) - t34);
    const sf_real t36 = t1 * t10;
    const sf_real t37 = ((t6 * t36) + (t3 * t16)) + (t29 * t17);
    by_q[13] = t37;
    const sf_real t38 = (t10 * t18) + (t3 * t37);
    const sf_real t39 = (t3 * t30) - (t10 * t19);
    const sf_real t40 = k1 * p5;
    const sf_real t41 = k1 * p6;
    const sf_real t42 = k1 * p7;
    const sf_real t43 = (t0 * t0) - (t6 * t6);
    const sf_real t44 = t0 * t6;
    const sf_real t45 = t44 + t44;
    const sf_real t46 = k1 * p8;
    const sf_real t47 = (((t0 * t40) + (t6 * t41)) + (t42 * t43)) + (t45 * t46);
    const sf_real t48 = (k1 * p3) + t47;
    const sf_real t49 = t6 * t48;
    const sf_real t50 = -t49;
    const sf_real t51 = (t50 - (t33 * t25)) + ((t32 * t25) + (t31 * t18));
    const sf_real t52 = (((tool0 * t25) + (tool1 * t18)) + (tool2 * t37)) + ((q4 * t37) + (t51 + (q0 * t18)));
    const sf_real t53 = t52 + t49;
    by_q[6] = (t35 * t38) - (t39 * t53);
    const sf_real t54 = t0 * t48;
    const sf_real t55 = -(t3 * t9);
    const sf_real t56 = (t55 + (t0 * t36)) - (t12 * t29);
    by_q[12] = t56;
    const sf_real t57 = ((t20 * t32) + (t15 * t31)) - (t54 + (t20 * t33));
    const sf_real t58 = (((t20 * tool0) + (t15 * tool1)) + (t56 * tool2)) + ((t56 * q4) + (t57 + (t15 * q0)));
    const sf_real t59 = t54 + t58;
    const sf_real t60 = (t10 * t15) + (t3 * t56);
    by_q[7] = (t39 * t59) - (t35 * t60);
    by_q[8] = (t53 * t60) - (t38 * t59);
    const sf_real t61 = (t8 * t17) - (t11 * t16);
    const sf_real t62 = -t45;
    const sf_real t63 = t62 + t62;
    const sf_real t64 = t43 + t43;
    const sf_real t65 = (((t0 * t41) - (t6 * t40)) + (t42 * t63)) + (t46 * t64);
    by_q[9] = ((t35 * t61) - t52) - (t0 * t65);
    const sf_real t66 = -(t12 * t8);
    const sf_real t67 = t66 + (t11 * t9);
    by_q[10] = (t58 - (t35 * t67)) - (t6 * t65);
    by_q[11] = (t52 * t67) - (t58 * t61);
    direction_by_q[0] = k2;
    direction_by_q[1] = k2;
    direction_by_q[2] = k2;
    direction_by_q[3] = k2;
    direction_by_q[4] = k2;
    direction_by_q[5] = k2;
    direction_by_q[12] = k2;
    direction_by_q[13] = k2;
    direction_by_q[14] = k2;
    direction_by_q[6] = (t30 * t38) - (t37 * t39);
    direction_by_q[7] = (t56 * t39) - (t30 * t60);
    direction_by_q[8] = (t37 * t60) - (t56 * t38);
    direction_by_q[9] = (t30 * t61) - t37;
    direction_by_q[10] = t56 - (t30 * t67);
    direction_by_q[11] = (t37 * t67) - (t56 * t61);

    return ((given != 0) && (sound(3 * SF_AXES, by_q, (sf_real)SF_LARGEST) != 0) && (sound(3 * SF_AXES, direction_by_q, (sf_real)SF_LARGEST) != 0)) ? SF_OK : SF_INVALID;
}

int sf_parameter_jacobian(const sf_real q[SF_AXES], const sf_real tool[3], const sf_real p[SF_P_SIZE], sf_real
                          by_p[3 * SF_PARAMETERS])
{
    int given = sound_pose(q, tool);

    if (sound_parameters(p) == 0) {
        given = 0;
    }

    const sf_real p0 = p[0];
    const sf_real p1 = p[1];
    const sf_real p2 = p[2];
    const sf_real p3 = p[3];
    const sf_real p4 = p[4];
    const sf_real p5 = p[5];
    const sf_real p6 = p[6];
    const sf_real p7 = p[7];
    const sf_real p8 = p[8];
    const sf_real q0 = q[0];
    const sf_real q1 = q[1];
    const sf_real q2 = q[2];
    const sf_real q3 = q[3];
    const sf_real q4 = q[4];
    const sf_real tool0 = tool[0];
    const sf_real tool1 = tool[1];
    const sf_real tool2 = tool[2];
    const sf_real k0 = (sf_real)(1e-06);
    const sf_real k1 = (sf_real)(0.001);
    const sf_real k2 = (sf_real)(0.0);
    const sf_real t0 = SF_COS(q3);
    const sf_real t1 = SF_COS(q2);
    const sf_real t2 = k0 * p4;
    const sf_real t3 = SF_SIN(t2);
    const sf_real t4 = SF_SIN(q3);
    const sf_real t5 = t3 * t4;
    const sf_real t6 = SF_SIN(q2);
    const sf_real t7 = (t0 * t1) + (t5 * t6);
    const sf_real t8 = k0 * p0;
    const sf_real t9 = SF_SIN(t8);
    const sf_real t10 = q1 * t9;
    const sf_real t11 = k0 * p2;
    const sf_real t12 = SF_SIN(t11);
    const sf_real t13 = t6 * t12;
    const sf_real t14 = -(t0 * t13);
    const sf_real t15 = SF_COS(t2);
    const sf_real t16 = t4 * t15;
    const sf_real t17 = SF_COS(t11);
    const sf_real t18 = t1 * t12;
    const sf_real t19 = (t14 - (t16 * t17)) + (t5 * t18);
    const sf_real t20 = SF_COS(t8);
    const sf_real t21 = t20 * q1;
    by_p[0] = -(k0 * ((t7 * t10) - (t19 * t21)));
    const sf_real t22 = t0 * t3;
    const sf_real t23 = -(t6 * t22);
    const sf_real t24 = t23 + (t1 * t4);
    const sf_real t25 = t0 * t15;
    const sf_real t26 = ((t17 * t25) - (t4 * t13)) - (t18 * t22);
    by_p[1] = -(k0 * ((t10 * t24) - (t21 * t26)));
    const sf_real t27 = (t3 * t17) + (t15 * t18);
    const sf_real t28 = t6 * t15;
    by_p[2] = -(k0 * ((t21 * t27) - (t10 * t28)));
    by_p[3] = -(t7 * k1);
    by_p[4] = -(k1 * t24);
    by_p[5] = k1 * t28;
    const sf_real t29 = -(tool0 * t28);
    const sf_real t30 = t1 * t17;
    const sf_real t31 = (t15 * t30) - (t3 * t12);
    const sf_real t32 = k1 * p1;
    const sf_real t33 = (((t10 * t27) + (t21 * t28)) - (t32 * t28)) + (q0 * t27);
    const sf_real t34 = ((t29 - (tool1 * t27)) + (tool2 * t31)) + ((q4 * t31) - t33);
    const sf_real t35 = t6 * t17;
    const sf_real t36 = ((t4 * t35) + (t12 * t25)) + (t30 * t22);
    const sf_real t37 = (t0 * t0) - (t4 * t4);
    const sf_real t38 = ((t0 * (k1 * p5)) + (t4 * (k1 * p6))) + ((k1 * p7) * t37);
    const sf_real t39 = t0 * t4;
    const sf_real t40 = t39 + t39;
    const sf_real t41 = (k1 * p3) + (t38 + (t40 * (k1 * p8)));
    const sf_real t42 = t4 * t41;
    const sf_real t43 = -t42;
    const sf_real t44 = (t43 - (t32 * t24)) + ((t21 * t24) + (t10 * t26));
    const sf_real t45 = (((tool0 * t24) + (tool1 * t26)) + (tool2 * t36)) + ((q4 * t36) + (t44 + (q0 * t26)));
    const sf_real t46 = t45 + t42;
    by_p[6] = -(k0 * ((t24 * t34) + (t28 * t46)));
    const sf_real t47 = t0 * t41;
    const sf_real t48 = -(t12 * t16);
    const sf_real t49 = (t48 + (t0 * t35)) - (t5 * t30);
    const sf_real t50 = (((t7 * t21) + (t19 * t10)) - (t47 + (t7 * t32))) + (t19 * q0);
    const sf_real t51 = (((t7 * tool0) + (t19 * tool1)) + (t49 * tool2)) + ((t49 * q4) + t50);
    const sf_real t52 = t47 + t51;
    const sf_real t53 = -(t28 * t52);
    by_p[7] = -(k0 * (t53 - (t7 * t34)));
    by_p[8] = -(k0 * ((t7 * t46) - (t24 * t52)));
    const sf_real t54 = t0 * k1;
    by_p[9] = -t54;
    const sf_real t55 = t4 * k1;
    by_p[10] = -t55;
    by_p[11] = k2;
    by_p[17] = k2;
    by_p[20] = k2;
    by_p[23] = k2;
    by_p[26] = k2;
    by_p[12] = -(k0 * (t4 * t34));
    by_p[13] = k0 * (t0 * t34);
    by_p[14] = -(k0 * ((t0 * t45) - (t4 * t51)));
    by_p[15] = -(t0 * t54);
    by_p[16] = -(t4 * t54);
    by_p[18] = -(t0 * t55);
    by_p[19] = -(t4 * t55);
    const sf_real t56 = k1 * t37;
    by_p[21] = -(t0 * t56);
    by_p[22] = -(t4 * t56);
    const sf_real t57 = k1 * t40;
    by_p[24] = -(t0 * t57);
    by_p[25] = -(t4 * t57);

    return ((given != 0) && (sound(3 * SF_PARAMETERS, by_p, (sf_real)SF_LARGEST) != 0)) ? SF_OK : SF_INVALID;
}

int sf_direction_jacobian(const sf_real q[SF_AXES], const sf_real tool[3], const sf_real p[SF_P_SIZE], sf_real
                          direction_by_p[3 * SF_PARAMETERS])
{
    int given = sound_pose(q, tool);

    if (sound_parameters(p) == 0) {
        given = 0;
    }

    const sf_real p2 = p[2];
    const sf_real p4 = p[4];
    const sf_real q2 = q[2];
    const sf_real q3 = q[3];
    const sf_real k0 = (sf_real)(0.0);
    const sf_real k1 = (sf_real)(1e-06);
    direction_by_p[0] = k0;
    direction_by_p[1] = k0;
    direction_by_p[2] = k0;
    direction_by_p[3] = k0;
    direction_by_p[4] = k0;
    direction_by_p[5] = k0;
    direction_by_p[9] = k0;
    direction_by_p[10] = k0;
    direction_by_p[11] = k0;
    direction_by_p[15] = k0;
    direction_by_p[16] = k0;
    direction_by_p[17] = k0;
    direction_by_p[18] = k0;
    direction_by_p[19] = k0;
    direction_by_p[20] = k0;
    direction_by_p[21] = k0;
    direction_by_p[22] = k0;
    direction_by_p[23] = k0;
    direction_by_p[24] = k0;
    direction_by_p[25] = k0;
    direction_by_p[26] = k0;
    const sf_real t0 = SF_SIN(q2);
    const sf_real t1 = SF_COS(q3);
    const sf_real t2 = k1 * p4;
    const sf_real t3 = SF_SIN(t2);
    const sf_real t4 = t1 * t3;
    const sf_real t5 = -(t0 * t4);
    const sf_real t6 = SF_COS(q2);
    const sf_real t7 = SF_SIN(q3);
    const sf_real t8 = t5 + (t6 * t7);
    const sf_real t9 = SF_COS(t2);
    const sf_real t10 = k1 * p2;
    const sf_real t11 = SF_COS(t10);
    const sf_real t12 = t6 * t11;
    const sf_real t13 = SF_SIN(t10);
    const sf_real t14 = (t9 * t12) - (t3 * t13);
    const sf_real t15 = t0 * t11;
    const sf_real t16 = ((t7 * t15) + (t13 * (t1 * t9))) + (t12 * t4);
    const sf_real t17 = t0 * t9;
    direction_by_p[6] = -(k1 * ((t8 * t14) + (t16 * t17)));
    const sf_real t18 = -(t13 * (t7 * t9));
    const sf_real t19 = t3 * t7;
    const sf_real t20 = (t18 + (t1 * t15)) - (t19 * t12);
    const sf_real t21 = -(t20 * t17);
    const sf_real t22 = (t1 * t6) + (t19 * t0);
    direction_by_p[7] = -(k1 * (t21 - (t22 * t14)));
    direction_by_p[8] = -(k1 * ((t22 * t16) - (t20 * t8)));
    direction_by_p[12] = -(k1 * (t7 * t14));
    direction_by_p[13] = k1 * (t1 * t14);
    direction_by_p[14] = -(k1 * ((t1 * t16) - (t7 * t20)));

    return ((given != 0) && (sound(3 * SF_PARAMETERS, direction_by_p, (sf_real)SF_LARGEST) != 0)) ? SF_OK : SF_INVALID;
}

static void nominal_slope(const sf_real q[SF_AXES], const sf_real tool[3], sf_real position[3], sf_real slope[9])
{
    const sf_real q0 = q[0];
    const sf_real q1 = q[1];
    const sf_real q2 = q[2];
    const sf_real q3 = q[3];
    const sf_real q4 = q[4];
    const sf_real tool0 = tool[0];
    const sf_real tool1 = tool[1];
    const sf_real tool2 = tool[2];
    const sf_real k0 = (sf_real)(0.0);
    const sf_real t0 = SF_COS(q3);

    slope[4] = t0;
    const sf_real t1 = SF_COS(q2);
    slope[8] = t1;
    const sf_real t2 = t0 * t1;
    slope[0] = t2;
    const sf_real t3 = SF_SIN(q3);
    const sf_real t4 = SF_SIN(q2);
    const sf_real t5 = t0 * t4;
    slope[6] = t5;
    position[0] = (((t2 * tool0) - (t3 * tool1)) + (tool2 * t5)) + (((t2 * q1) - (t3 * q0)) + (q4 * t5));
    const sf_real t6 = t1 * t3;
    slope[1] = t6;
    const sf_real t7 = t3 * t4;
    slope[7] = t7;
    position[1] = (((t0 * tool1) + (tool0 * t6)) + (tool2 * t7)) + ((q4 * t7) + ((t0 * q0) + (q1 * t6)));
    position[2] = ((t1 * tool2) - (t4 * tool0)) + ((t1 * q4) - (t4 * q1));
    slope[2] = -t4;
    slope[3] = -t3;
    slope[5] = k0;
}

static void real_slope(const sf_real q[SF_AXES], const sf_real tool[3], const sf_real p[SF_P_SIZE], sf_real
                       position[3], sf_real slope[9])
{
    const sf_real p0 = p[0];
    const sf_real p1 = p[1];
    const sf_real p2 = p[2];
    const sf_real p3 = p[3];
    const sf_real p4 = p[4];
    const sf_real p5 = p[5];
    const sf_real p6 = p[6];
    const sf_real p7 = p[7];
    const sf_real p8 = p[8];
    const sf_real q0 = q[0];
    const sf_real q1 = q[1];
    const sf_real q2 = q[2];
    const sf_real q3 = q[3];
    const sf_real q4 = q[4];
    const sf_real tool0 = tool[0];
    const sf_real tool1 = tool[1];
    const sf_real tool2 = tool[2];
    const sf_real k0 = (sf_real)(1e-06);
    const sf_real k1 = (sf_real)(0.001);
    const sf_real t0 = SF_COS(q3);
    const sf_real t1 = SF_COS(q2);
    const sf_real t2 = k0 * p4;
    const sf_real t3 = SF_SIN(t2);
    const sf_real t4 = SF_SIN(q3);
    const sf_real t5 = t3 * t4;
    const sf_real t6 = SF_SIN(q2);
    const sf_real t7 = (t0 * t1) + (t5 * t6);
    const sf_real t8 = k0 * p2;
    const sf_real t9 = SF_SIN(t8);
    const sf_real t10 = t6 * t9;
    const sf_real t11 = -(t0 * t10);
    const sf_real t12 = SF_COS(t2);
    const sf_real t13 = t4 * t12;
    const sf_real t14 = SF_COS(t8);
    const sf_real t15 = t1 * t9;
    const sf_real t16 = (t11 - (t13 * t14)) + (t5 * t15);

    slope[3] = t16;
    const sf_real t17 = -(t9 * t13);
    const sf_real t18 = t6 * t14;
    const sf_real t19 = t1 * t14;
    const sf_real t20 = (t17 + (t0 * t18)) - (t5 * t19);
    slope[6] = t20;
    const sf_real t21 = k0 * p0;
    const sf_real t22 = SF_COS(t21);
    const sf_real t23 = t22 * q1;
    const sf_real t24 = SF_SIN(t21);
    const sf_real t25 = q1 * t24;
    const sf_real t26 = ((t0 * (k1 * p5)) + (t4 * (k1 * p6))) + ((k1 * p7) * ((t0 * t0) - (t4 * t4)));
    const sf_real t27 = t0 * t4;
    const sf_real t28 = (k1 * p3) + (t26 + ((t27 + t27) * (k1 * p8)));
    const sf_real t29 = k1 * p1;
    const sf_real t30 = ((t7 * t23) + (t16 * t25)) - ((t0 * t28) + (t7 * t29));
    position[0] = (((t7 * tool0) + (t16 * tool1)) + (t20 * tool2)) + ((t20 * q4) + (t30 + (t16 * q0)));
    const sf_real t31 = t0 * t3;
    const sf_real t32 = -(t6 * t31);
    const sf_real t33 = t32 + (t1 * t4);
    const sf_real t34 = t0 * t12;
    const sf_real t35 = ((t14 * t34) - (t4 * t10)) - (t15 * t31);
    slope[4] = t35;
    const sf_real t36 = ((t4 * t18) + (t9 * t34)) + (t19 * t31);
    slope[7] = t36;
    const sf_real t37 = -(t4 * t28);
    const sf_real t38 = (t37 - (t29 * t33)) + ((t23 * t33) + (t25 * t35));
    position[1] = (((tool0 * t33) + (tool1 * t35)) + (tool2 * t36)) + ((q4 * t36) + (t38 + (q0 * t35)));
    const sf_real t39 = t6 * t12;
    const sf_real t40 = -(tool0 * t39);
    const sf_real t41 = (t3 * t14) + (t12 * t15);
    const sf_real t42 = (t12 * t19) - (t3 * t9);
    slope[8] = t42;
    const sf_real t43 = (((t25 * t41) + (t23 * t39)) - (t29 * t39)) + (q0 * t41);
    position[2] = ((t40 - (tool1 * t41)) + (tool2 * t42)) + ((q4 * t42) - t43);
    slope[0] = (t7 * t22) + (t16 * t24);
    slope[1] = (t22 * t33) + (t24 * t35);
    const sf_real t44 = -(t22 * t39);
    slope[2] = t44 - (t24 * t41);
    slope[5] = -t41;
}

/* Solves a 3x3 system, matrix column by column, by its cofactors; 0 where the columns lie in one plane. */
static int solve3(const sf_real m[9], const sf_real right[3], sf_real x[3])
{
    const sf_real c0 = (m[4] * m[8]) - (m[5] * m[7]);
    const sf_real c1 = (m[5] * m[6]) - (m[3] * m[8]);
    const sf_real c2 = (m[3] * m[7]) - (m[4] * m[6]);
    const sf_real determinant = (m[0] * c0) + (m[1] * c1) + (m[2] * c2);
    const sf_real least = (sf_real)1.0e-4;
    int solved = 0;

    if ((determinant > least) || (determinant < -least)) {
        const sf_real s0 = (right[1] * m[8]) - (right[2] * m[7]);
        const sf_real s1 = (right[2] * m[6]) - (right[0] * m[8]);
        const sf_real s2 = (right[0] * m[7]) - (right[1] * m[6]);
        const sf_real r0 = (m[4] * right[2]) - (m[5] * right[1]);
        const sf_real r1 = (m[5] * right[0]) - (m[3] * right[2]);
        const sf_real r2 = (m[3] * right[1]) - (m[4] * right[0]);

        x[0] = ((right[0] * c0) + (right[1] * c1) + (right[2] * c2)) / determinant;
        x[1] = ((m[0] * s0) + (m[1] * s1) + (m[2] * s2)) / determinant;
        x[2] = ((m[0] * r0) + (m[1] * r1) + (m[2] * r2)) / determinant;
        solved = 1;
    }
    return solved;
}

int sf_inverse_nominal(const sf_real target[3], const sf_real tool[3],
                       sf_real q[SF_AXES])
{
    const int solved[3] = { 1, 0, 4 };
    const sf_real farthest = (sf_real)SF_FARTHEST;
    sf_real start[SF_AXES];
    int status = SF_INVALID;
    int i;

    for (i = 0; i < SF_AXES; ++i) {
        start[i] = q[i];
    }
    for (i = 0; i < 3; ++i) {
        start[solved[i]] = (sf_real)0.0;
    }
    if ((sound_pose(start, tool) != 0) && (sound(3, target, farthest) != 0)) {
        sf_real position[3];
        sf_real slope[9];
        sf_real missing[3];
        sf_real x[3];

        status = SF_UNREACHABLE;
        nominal_slope(start, tool, position, slope);
        for (i = 0; i < 3; ++i) {
            missing[i] = target[i] - position[i];
        }
        if ((solve3(slope, missing, x) != 0) && (sound(3, x, farthest) != 0)) {
            for (i = 0; i < 3; ++i) {
                q[solved[i]] = x[i];
            }
            status = SF_OK;
        }
    }
    return status;
}

static sf_real largest(const sf_real x[3])
{
    sf_real size = SF_FABS(x[0]);
    int i;

    for (i = 1; i < 3; ++i) {
        const sf_real other = SF_FABS(x[i]);
        if (other > size) {
            size = other;
        }
    }
    return size;
}

/*
 * Newton's iteration for the point. Steps shrink at least as fast from one to the next as they did before, so that what is
 * missing after a step is known without another one. Anything but SF_OK leaves q somewhere.
 */
static int approach(const sf_real target[3], const sf_real tool[3],
                    const sf_real p[SF_P_SIZE], sf_real q[SF_AXES])
{
    const int solved[3] = { 1, 0, 4 };
    const sf_real farthest = (sf_real)SF_FARTHEST;
    const sf_real tolerance = (sf_real)SF_TOLERANCE;
    sf_real before = (sf_real)0.0;
    int status = SF_NOT_CONVERGED;
    int step = 0;
    int going = 1;

    while ((going != 0) && (step < SF_ITERATIONS)) {
        sf_real position[3];
        sf_real slope[9];
        sf_real missing[3];
        sf_real x[3];
        int i;

        real_slope(q, tool, p, position, slope);
        for (i = 0; i < 3; ++i) {
            missing[i] = target[i] - position[i];
        }
        if (solve3(slope, missing, x) == 0) {
            status = SF_UNREACHABLE;
            going = 0;
        } else if (sound(3, x, farthest) == 0) {
            going = 0;
        } else {
            const sf_real size = largest(x);

            for (i = 0; i < 3; ++i) {
                q[solved[i]] += x[i];
            }
            if ((size <= tolerance) || ((size < before) && ((size * size) <= (tolerance * before)))) {
                status = SF_UNREACHABLE;
                going = 0;
                if (sound(SF_AXES, q, farthest) != 0) {
                    status = SF_OK;
                }
            }
            before = size;
        }
        ++step;
    }
    return status;
}

/* The result of a solution that may be used, otherwise q stays as it is. */
static int taken(int status, const sf_real found[SF_AXES], sf_real q[SF_AXES])
{
    int i;

    for (i = 0; ((status == SF_OK) || (status == SF_SINGULAR)) && (i < SF_AXES); ++i) {
        q[i] = found[i];
    }
    return status;
}

int sf_inverse(const sf_real target[3], const sf_real tool[3],
               const sf_real p[SF_P_SIZE], sf_real q[SF_AXES])
{
    sf_real found[SF_AXES];
    int status;
    int i;

    for (i = 0; i < SF_AXES; ++i) {
        found[i] = q[i];
    }
    status = (sound_parameters(p) != 0) ? sf_inverse_nominal(target, tool, found) : SF_INVALID;
    if (status == SF_OK) {
        status = approach(target, tool, p, found);
    }
    return taken(status, found, q);
}

int sf_compensate(const sf_real wanted[SF_AXES], const sf_real tool[3],
                  const sf_real p[SF_P_SIZE], sf_real q[SF_AXES])
{
    sf_real target[3];
    sf_real direction[3];
    sf_real found[SF_AXES];
    int status = sf_nominal(wanted, tool, target, direction);
    int i;

    for (i = 0; i < SF_AXES; ++i) {
        found[i] = wanted[i];
    }
    if ((status == SF_OK) && (sound_parameters(p) == 0)) {
        status = SF_INVALID;
    }
    if (status == SF_OK) {
        status = approach(target, tool, p, found);
    }
    return taken(status, found, q);
}

static sf_real dot3(const sf_real a[3], const sf_real b[3])
{
    return (a[0] * b[0]) + (a[1] * b[1]) + (a[2] * b[2]);
}

/* The angle about the unit vector e that turns u into v (both with the same component along e). */
static sf_real angle_about(const sf_real e[3], const sf_real u[3], const sf_real v[3])
{
    const sf_real cross[3] = { (u[1] * v[2]) - (u[2] * v[1]), (u[2] * v[0]) - (u[0] * v[2]),
                               (u[0] * v[1]) - (u[1] * v[0]) };

    return SF_ATAN2(dot3(e, cross), dot3(u, v) - (dot3(e, u) * dot3(e, v)));
}

/* The same angle in the turn that is nearest to a reference. */
static sf_real nearest_turn(sf_real angle, sf_real reference)
{
    const sf_real turn = (sf_real)6.283185307179586;

    return angle + (turn * SF_FLOOR(((reference - angle) / turn) + (sf_real)0.5));
}

/*
 * Two turns about crossing directions (Paden and Kahan's second subproblem): the tool's axis turned by the second axis and
 * the wanted direction turned back by the first one are the same vector c; its components along both axes are known.
 */
static int turned(const sf_real direction[3], sf_real q[SF_AXES])
{
    const sf_real first[3] = { (sf_real)0.0, (sf_real)0.0, (sf_real)1.0 };
    const sf_real second[3] = { (sf_real)0.0, (sf_real)1.0, (sf_real)0.0 };
    const sf_real normal[3] = { (sf_real)-1.0, (sf_real)0.0, (sf_real)0.0 };
    const sf_real tool_axis[3] = { (sf_real)0.0, (sf_real)0.0, (sf_real)1.0 };
    const sf_real one = (sf_real)1.0;
    const sf_real both = dot3(first, second);
    const sf_real wide = one - (both * both);
    const sf_real along = dot3(direction, first);
    const sf_real own = dot3(tool_axis, second);
    const sf_real a = (along - (both * own)) / wide;
    const sf_real b = (own - (both * along)) / wide;
    const sf_real rest = (one - ((a * a) + (b * b) + ((sf_real)2.0 * a * b * both))) / wide;
    const sf_real slack = SF_SLACK;
    int status = SF_OK;

    if (!(rest >= -slack)) {
        status = SF_UNREACHABLE;
    } else {
        const sf_real height = (rest > (sf_real)0.0) ? SF_SQRT(rest) : (sf_real)0.0;
        const sf_real sine2 = one - (along * along);
        sf_real best[2] = { q[3], q[2] };
        sf_real least = (sf_real)-1.0;
        int side;

        if (sine2 <= slack) {
            status = SF_SINGULAR;
        }
        for (side = -1; side <= 1; side += 2) {
            const sf_real h = (side < 0) ? -height : height;
            const sf_real c[3] = { (a * first[0]) + (b * second[0]) + (h * normal[0]),
                                   (a * first[1]) + (b * second[1]) + (h * normal[1]),
                                   (a * first[2]) + (b * second[2]) + (h * normal[2]) };
            const sf_real q2 = nearest_turn(angle_about(second, tool_axis, c), q[2]);
            const sf_real q1 = (status == SF_SINGULAR)
                                   ? q[3]
                                   : nearest_turn(angle_about(first, c, direction), q[3]);
            const sf_real d1 = q1 - q[3];
            const sf_real d2 = q2 - q[2];
            const sf_real far = (d1 * d1) + (d2 * d2);

            if ((least < (sf_real)0.0) || (far < least)) {
                least = far;
                best[0] = q1;
                best[1] = q2;
            }
        }
        q[3] = best[0];
        q[2] = best[1];
    }
    return status;
}

int sf_orient(const sf_real direction[3], sf_real q[SF_AXES])
{
    const sf_real slack = (sf_real)SF_UNIT_TOLERANCE;
    const sf_real one = (sf_real)1.0;
    int status = SF_INVALID;

    if ((sound(3, direction, one + slack) != 0) && (sound(SF_AXES, q, (sf_real)SF_FARTHEST) != 0)) {
        const sf_real length = SF_SQRT(dot3(direction, direction));

        if (SF_FABS(length - one) <= slack) {
            const sf_real unit[3] = { direction[0] / length, direction[1] / length, direction[2] / length };

            status = turned(unit, q);
        }
    }
    return status;
}

/*
 * What is solved near a wanted pose: the rotary axes' steps x that take away the tilt of the real tool, base' (now - direction) = 0
 * with the slopes `base` of the direction there. Where their smallest singular value s is below a width w, a tilt asks for
 * motions that are larger than itself by 1 / s; the factor is then s (2 w^2 - s^2) / w^4, which passes into 1 / s at w without
 * a kink and is nothing at the singular pose itself. It is what a spring along the weak combination of the axes does:
 * base' (now - direction) + hold x = 0. With w^2 = 4 tilts the commands turn at most half as far more as is wanted.
 */
static int held(const sf_real first[3], const sf_real second[3], sf_real tilt, sf_real hold[3])
{
    const sf_real two = (sf_real)2.0;
    const sf_real a = dot3(first, first);
    const sf_real b = dot3(first, second);
    const sf_real c = dot3(second, second);
    const sf_real apart = SF_SQRT(((a - c) * (a - c)) + (two * two * b * b));
    const sf_real strong = (a + c + apart) / two;
    const sf_real weak = ((a * c) - (b * b)) / strong; /* the square of s */
    const sf_real width = SF_NARROWEST + (two * two * tilt);
    int near = 0;

    hold[0] = (sf_real)0.0;
    hold[1] = (sf_real)0.0;
    hold[2] = (sf_real)0.0;
    if ((weak < width) && (apart > (sf_real)0.0)) {
        const sf_real spring = (((width * width) / ((two * width) - weak)) - weak) / apart;

        hold[0] = spring * (strong - a);
        hold[1] = -(spring * b);
        hold[2] = spring * (strong - c);
        near = 1;
    }
    return near;
}

int sf_compensate_direction(const sf_real wanted[SF_AXES], const sf_real tool[3],
                            const sf_real p[SF_P_SIZE], sf_real q[SF_AXES])
{
    sf_real target[3];
    sf_real direction[3];
    sf_real found[SF_AXES];
    sf_real first[3];
    sf_real second[3];
    sf_real hold[3];
    sf_real x[2] = { (sf_real)0.0, (sf_real)0.0 };
    int status = sf_nominal(wanted, tool, target, direction);
    int near = 0;
    int going = 1;
    int step = 0;
    int i;

    for (i = 0; i < SF_AXES; ++i) {
        found[i] = wanted[i];
    }
    if ((status == SF_OK) && (sound_parameters(p) == 0)) {
        status = SF_INVALID;
    }
    if (status == SF_OK) {
        status = approach(target, tool, p, found);
    }
    while ((going != 0) && (status == SF_OK)) {
        sf_real position[3];
        sf_real now[3];
        sf_real by_q[3 * SF_AXES];
        sf_real slopes[3 * SF_AXES];
        sf_real tilt[3];

        (void)sf_forward(found, tool, p, position, now);
        (void)sf_axis_jacobian(found, tool, p, by_q, slopes);
        for (i = 0; i < 3; ++i) {
            tilt[i] = direction[i] - now[i];
        }
        if (step == 0) {
            for (i = 0; i < 3; ++i) {
                first[i] = slopes[9 + i];
                second[i] = slopes[6 + i];
            }
            near = held(first, second, SF_SQRT(dot3(tilt, tilt)), hold);
        }
        {
            const sf_real u = dot3(first, tilt) - ((hold[0] * x[0]) + (hold[1] * x[1]));
            const sf_real v = dot3(second, tilt) - ((hold[1] * x[0]) + (hold[2] * x[1]));
            const sf_real m00 = dot3(first, &slopes[9]) + hold[0];
            const sf_real m01 = dot3(first, &slopes[6]) + hold[1];
            const sf_real m10 = dot3(second, &slopes[9]) + hold[1];
            const sf_real m11 = dot3(second, &slopes[6]) + hold[2];
            const sf_real determinant = (m00 * m11) - (m01 * m10);
            const sf_real by[2] = { ((m11 * u) - (m01 * v)) / determinant, ((m00 * v) - (m10 * u)) / determinant };

            if ((step >= SF_ITERATIONS) || (sound(2, by, (sf_real)1.0) == 0)) {
                status = SF_NOT_CONVERGED;
            } else {
                x[0] += by[0];
                x[1] += by[1];
                found[3] = wanted[3] + x[0];
                found[2] = wanted[2] + x[1];
                status = approach(target, tool, p, found);
                if (sound(2, by, SF_LAST_TURN) != 0) {
                    going = 0;
                }
            }
        }
        ++step;
    }
    if ((status == SF_OK) && (near != 0)) {
        status = SF_SINGULAR;
    }
    return taken(status, found, q);
}
