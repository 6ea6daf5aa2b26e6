"""Relative frequencies of effects: prior odds where readings cannot separate two names.

No count of machines is published. The order in which the makers of ball bars list what their software finds (backlash, reversal
spikes, lateral play, cyclic error, servo mismatch, scaling, squareness, straightness: Quality Magazine, "The ins and outs of
ballbar calibration", article 84126) stands for it, the n-th with a weight of 1/n (G. K. Zipf 1949); what is not in the list has
the last one's.
"""

from __future__ import annotations

_LISTED = (
    "backlash", "friction", "lateral_play", "transmission_error", "servo_mismatch", "scale_error", "location_error",
    "error_motion",
)  # fmt: skip


def rate_of(word: str) -> float:
    """The weight of a word of the vocabulary."""
    return 1.0 / (1 + _LISTED.index(word)) if word in _LISTED else 1.0 / len(_LISTED)
