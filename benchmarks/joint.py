"""What R-test, ball bar, circles and touch probe gain together over the best single one in the same minutes.

    .venv/bin/python benchmarks/joint.py [--minutes 20] [MACHINE ...]

By preset machine: the mean variance (criterion A, prior variance = 1) that the relaxed design of every single instrument reaches,
that of the best mix found with whole mountings, the lowest that any mix can have (searched over a dense set), and the most that a
mix can gain over the best single instrument. One core.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import math
import time

from symfive.design._joint_certificate import shared_minutes
from symfive.machine import preset, presets
from symfive.threads import one_thread

KINDS = ("r_test", "ball_bar", "touch_probe", "circles")


@one_thread
def compared(name: str, minutes: float) -> None:
    """One line."""
    start = time.process_time()
    shared = shared_minutes(preset(name))
    single = {kind: math.exp(mix.value) for kind, mix in shared.alone(minutes).single().items()}
    joint = shared.joint(minutes)
    best, bound = joint.best(), math.exp(joint.lowest())
    mounted = ", ".join(f"{best.kinds.count(kind)} {kind}" for kind in dict.fromkeys(best.kinds))
    told = "".join(f"{single[kind]:12.4f}" if kind in single else f"{'-':>12}" for kind in KINDS)
    most, spent = min(single.values()) / bound, time.process_time() - start
    print(f"{name:15}{told}{math.exp(best.value):9.4f}{bound:9.4f}{most:7.2f}{spent:7.0f}  {mounted}", flush=True)


def main() -> None:
    """The table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("machines", nargs="*", metavar="MACHINE", help=f"only these: {', '.join(presets())}")
    parser.add_argument("--minutes", type=float, default=20.0)
    options = parser.parse_args()
    head = "".join(f"{kind:>12}" for kind in KINDS)
    print(f"{'machine':15}{head}{'joint':>9}{'lowest':>9}{'gain ≤':>7}{'CPU s':>7}  mounted for the joint design")
    for name in options.machines or presets():
        compared(name, options.minutes)


if __name__ == "__main__":
    main()
