"""The picture of the README: `python examples/demo/picture.py` writes `docs/geometry.svg`.

A tilting table sags under gravity by 9 µm. The same readings are identified twice: with rigid geometry and the noise of the
instrument's data sheet, as a calibration usually does, and with the sag of axis B that the demonstration's diagnosis finds.
Drawn is identified minus true, so that 0 is right.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import matplotlib
from demo import SAG, conceal
from matplotlib.figure import Figure

from symfive.drawing import BLUE, FAINT, INK, ORANGE, PAPER
from symfive.identify import Identification, identify
from symfive.machine import preset

K = 2.0
"""Coverage factor of the expanded uncertainty, 95 %."""


def picture(rigid: Identification, sagging: Identification, truth: Mapping[str, float]) -> Figure:
    """The orientations of all axes, identified minus true with ±U (k = 2), from both fits."""
    figure = Figure(figsize=(8.2, 3.4), layout="constrained", facecolor=PAPER)
    axes = figure.subplots()
    terms = [term for term in rigid.model.machine.location_errors if term.angular]
    fits = ((rigid, -0.16, ORANGE, "rigid geometry"), (sagging, 0.16, BLUE, "rigid geometry and sag of axis B"))
    for result, shift, colour, words in fits:
        off = [result[term.name] - truth[term.name] for term in terms]
        u = [K * result.uncertainty(term.name) for term in terms]
        rows = [row + shift for row in range(len(terms))]
        axes.errorbar(off, rows, xerr=u, fmt="o", color=colour, markersize=5.0, elinewidth=2.4, label=words)
    axes.axvline(0.0, color=INK, linewidth=0.8)
    axes.set_yticks(range(len(terms)), [f"{t.name}: {t.axis} about {'XYZ'['ABC'.index(t.component)]}" for t in terms])
    axes.set_ylim(len(terms) - 0.5, -0.5)
    axes.set_facecolor("none")
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel("orientation of an axis, identified − true / (µm/m)")
    axes.legend(loc="center right", frameon=False, title="the same readings, fitted with", alignment="left")
    axes.annotate(
        "the sag, taken for a squareness error", (18.3, 1.8), (19.3, 1.5), color=FAINT, ha="right", fontsize=8.5
    )
    return figure


def main() -> None:
    """Identify the sagging table twice and draw it."""
    parser = argparse.ArgumentParser(description="Draw the README's picture.")
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/geometry.svg"))
    output: Path = parser.parse_args().output
    measured = conceal(preset("table-bc"))
    rigid = identify(measured.campaign, noise="declared")
    sagging = identify(measured.campaign, effects=[SAG])
    with matplotlib.rc_context({"svg.hashsalt": "symfive", "font.size": 9.5}):
        picture(rigid, sagging, measured.truth).savefig(
            output, metadata={"Date": None} if output.suffix == ".svg" else {}
        )


if __name__ == "__main__":
    main()
