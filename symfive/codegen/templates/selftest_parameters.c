    {
        ${prefix}_real by_p[3 * ${PREFIX}_PARAMETERS];

        ${prefix}_parameter_jacobian(q, tool, p, by_p);
        expect("parameter jacobian", number, apart(3 * ${PREFIX}_PARAMETERS, by_p, vector_by_p[number], 1), SLOPE_LIMIT);
    }
