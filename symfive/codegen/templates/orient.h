
/*
 * Rotary axes $first and $second for a tool direction (nominal). q enters as the position to stay near to (whole turns are
 * kept) and leaves with $first and $second replaced. ${PREFIX}_SINGULAR: the direction lies along axis $first, whose
 * position is then free and stays as it was; q is valid. ${PREFIX}_UNREACHABLE: q is unchanged.
 */
int ${prefix}_orient(const ${prefix}_real direction[3], ${prefix}_real q[${PREFIX}_AXES]);
