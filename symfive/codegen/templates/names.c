void ${prefix}_parameters(${prefix}_real p[${PREFIX}_P_SIZE])
{
$assignments
}

const char *${prefix}_model(void)
{
    return ${PREFIX}_MODEL;
}

const char *${prefix}_parameter_name(int index)
{
    static const char *const names[${PREFIX}_P_SIZE] = {
$names
    };

    return ((index >= 0) && (index < ${PREFIX}_PARAMETERS)) ? names[index] : "";
}

int ${prefix}_error(const ${prefix}_real q[${PREFIX}_AXES], const ${prefix}_real tool[3],
             const ${prefix}_real p[${PREFIX}_P_SIZE], ${prefix}_real error[3], ${prefix}_real tilt[3])
{
    ${prefix}_real position[3];
    ${prefix}_real direction[3];
    ${prefix}_real nominal_position[3];
    ${prefix}_real nominal_direction[3];
    const int status = ${prefix}_forward(q, tool, p, position, direction);
    int i;

    (void)${prefix}_nominal(q, tool, nominal_position, nominal_direction);
    for (i = 0; i < 3; ++i) {
        error[i] = position[i] - nominal_position[i];
        tilt[i] = direction[i] - nominal_direction[i];
    }
    return status;
}
