"""An identification in words: what `symfive identify` prints."""

from __future__ import annotations

from symfive.identify import Identification
from symfive.numbers import expected_ratio, plain_number, rounded, unit_words
from symfive.report._words import confounded_machine, meaning, verdict
from symfive.screen import aligned, wrapped
from symfive.worth import location_worths, worth_text


def identification_text(identification: Identification) -> str:
    """The verdict, value ± 1σ of the machine's parameters, fit, what the readings cannot separate, and what correcting each
    location error is worth."""
    machine, index = identification.model.machine, identification.model.index
    rows = [("parameter", "value", "1σ", "unit", "prior 1σ", "meaning")]
    rows += [
        (name, rounded(value, std, unit), rounded(std, std, unit), unit_words(unit), plain_number(prior, unit),
         meaning(identification.parameters[index[name]], machine))
        for name, value, std, unit, prior in identification.table()
    ]  # fmt: skip
    unit = identification.unit
    lines = [
        *aligned(rows, right=(1, 2, 4)),
        f"rms {plain_number(identification.rms_um, unit)} {unit}, chi²/dof {identification.chi2_dof:.3f} against the declared "
        f"noise ({expected_ratio(identification.dof)})",
        f"The readings determine {identification.rank} of {len(identification.parameters)} parameters, set-up included.",
    ]
    worth = worth_text(location_worths(identification))
    return "\n".join(
        [
            *wrapped("", verdict(identification)),
            "",
            *lines,
            *confounded_machine(identification),
            *([worth] if worth else []),
        ]
    )
