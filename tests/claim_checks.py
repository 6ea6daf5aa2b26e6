"""What a claim of a paper must satisfy, whichever way it turned out."""

import math

from examples.claims import Claim


def assert_reproduced(claim: Claim) -> None:
    assert claim.low <= claim.ours <= claim.high
    assert not math.isnan(claim.ours)
    assert claim.verdict == "reproduced"


def assert_refuted(claim: Claim) -> None:
    assert claim.verdict == "wrong"
    assert len(claim.note) > 20
