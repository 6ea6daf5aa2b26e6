"""The paper's figures anew, and three of its consequences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from .concealed import View
from .information import Curve
from .path import Circle
from .readings import Trace
from .simulations import DRAWN, ECCENTRIC_UM, FEEDS, RATIOS, SIZES, Simulations
from .twin import Comparison

Array = NDArray[np.float64]
BLUE, ORANGE, GREEN, GREY, RED = "#0072b2", "#d55e00", "#009e73", "#777777", "#cc3377"
BLACK = "#000000"


def save_all(
    folder: Path,
    found: Simulations,
    comparisons: Sequence[tuple[str, Comparison]],
    view: View,
    true: Trace,
    curve: Curve,
) -> list[Path]:
    """Every figure as PNG; `true` is the centred machine's trace. Returns the files."""
    figures = {
        "fig-03-speeds": speeds(),
        "fig-05-trajectories": trajectories(found),
        "fig-06-feeds": feeds(found),
        "fig-07-feed-forward": feedforward(found),
        "fig-10-roundness": roundness(found),
        "fig-12-13-eccentric-traces": eccentric_traces(found),
        "fig-14-eccentricity": eccentricity(found),
        "symfive-beside-the-paper": beside(comparisons),
        "concealed-peak": concealed(view, true),
        "information": information(curve),
    }
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for name, figure in figures.items():
        files.append(folder / f"{name}.png")
        figure.savefig(files[-1], dpi=110)
    return files


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def _row(count: int, *, width: float = 4.2, height: float = 3.6) -> tuple[Figure, list[Axes]]:
    figure = _figure(width * count, height)
    return figure, [figure.add_subplot(1, count, k + 1) for k in range(count)]


def _over_phi(axes: Axes, low: float = 0.0, high: float = 360.0, step: float = 90.0) -> None:
    axes.set_xlim(low, high)
    axes.set_xticks(np.arange(low, high + 1.0, step))
    axes.set_xlabel("φ / degree")
    axes.grid(alpha=0.3)


def _polar(axes: Axes, traces: Sequence[tuple[Trace, str, str]], *, division: float, rings: int) -> None:
    """Traces about a circle of radius 0 µm; one ring is one division."""
    assert isinstance(axes, PolarAxes)
    for trace, colour, label in traces:
        axes.plot(np.radians(trace.deg), trace.um, color=colour, lw=0.9, label=label)
    axes.set_ylim(-division * 2 * rings, division * rings)
    axes.set_yticks(np.arange(-rings, rings + 1) * division, [""] * (2 * rings + 1))
    around = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(around, np.zeros_like(around), color="black", lw=0.6)
    axes.set_thetagrids([0, 90, 180, 270])
    axes.tick_params(labelsize=8)


def speeds() -> Figure:
    """Figure 3: commanded speeds of X and C over φ."""
    figure, (left, right) = _row(2)
    phi = np.radians(np.linspace(0.0, 359.9, 3600))
    for x_t, colour in ((45.0, BLUE), (50.0, GREY), (55.0, ORANGE)):
        circle = Circle(x_t)
        x_rate, theta_rate = 60.0 * circle.x_rate(phi), np.degrees(circle.theta_rate(phi)) * 60.0
        left.plot(np.degrees(phi), x_rate, color=colour, label=f"X_T = {x_t:g} mm")
        right.plot(np.degrees(phi), theta_rate, color=colour, label=f"X_T = {x_t:g} mm")
        for turn, side in zip(np.degrees(circle.reversals), ("right", "left"), strict=False):
            right.plot(turn, 0.0, "o", color=colour, ms=4)
            right.annotate(f" {turn:.1f}° ", (turn, 0.0), (0, 4), textcoords="offset points", ha=side, fontsize=8)
    left.set_ylabel("speed of X / (mm/min)")
    right.set_ylabel("speed of C / (degree/min)")
    right.set_yscale("symlog", linthresh=300.0)
    right.set_yticks([-10000.0, -1000.0, 0.0, 573.0, 11459.0], ["-10000", "-1000", "0", "573", "11459"])
    right.set_yticks([], minor=True)
    for axes in (left, right):
        _over_phi(axes)
    left.legend(fontsize=8)
    figure.suptitle("Fig. 3: r = 50 mm, F = 1000 mm/min; dots: C turns back", fontsize=10)
    return figure


def trajectories(found: Simulations) -> Figure:
    """Figure 5: simulated trajectories, both directions."""
    figure = _figure(12.0, 4.6)
    for k, u in enumerate(DRAWN):
        axes = figure.add_subplot(1, 3, k + 1, projection="polar")
        ccw, cw = found.trace(u).without_circle(), found.clockwise[u].trace().without_circle()
        _polar(axes, [(ccw, BLUE, "counter-clockwise"), (cw, ORANGE, "clockwise")], division=5.0, rings=4)
        fastest = np.degrees(Circle(50.0 * u).fastest_c) * 60.0
        axes.set_title(f"X_T = {50.0 * u:g} mm, fastest C {fastest:.0f} °/min", fontsize=9)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8)
    figure.suptitle("Fig. 5: r = 50 mm, F = 1000 mm/min, division 5 µm, least-squares circle taken out", fontsize=10)
    return figure


def feeds(found: Simulations) -> Figure:
    """Figure 6: the peak over feed and size."""
    figure, both = _row(2)
    for axes, (radius, x_t) in zip(both, SIZES, strict=True):
        for feed, colour in zip(FEEDS, (GREEN, BLUE, ORANGE), strict=True):
            trace = found.stretches[radius, feed]
            axes.plot(trace.deg, trace.um, color=colour, label=f"F = {feed:g} mm/min")
        _over_phi(axes, 150.0, 210.0, 10.0)
        axes.set_ylim(-4.0, 35.0)
        axes.set_ylabel("deviation / µm")
        axes.set_title(f"r = {radius:g} mm, X_T = {x_t:g} mm", fontsize=9)
    both[0].legend(fontsize=8)
    figure.suptitle("Fig. 6: loops alone; the peak grows with F² and with the speed of C", fontsize=10)
    return figure


def feedforward(found: Simulations) -> Figure:
    """Figure 7: feed-forward, and matched velocity loops."""
    figure, both = _row(2)
    names = (("table 1", GREY), ("feed-forward", ORANGE), ("feed-forward and matched", BLUE))
    for axes, form, title in zip(
        both, ("linear", "full"), ("loops alone", "with friction, worm and play"), strict=True
    ):
        for name, colour in names:
            trace = found.servos[name, form].trace()
            axes.plot(trace.deg, trace.um, color=colour, lw=0.9, label=name)
        _over_phi(axes, 150.0, 210.0, 10.0)
        axes.set_ylabel("deviation / µm")
        axes.set_title(title, fontsize=9)
    figure.legend(*both[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    figure.suptitle("Fig. 7: X_T = 45 mm, F = 1000 mm/min", fontsize=10)
    return figure


def roundness(found: Simulations) -> Figure:
    """Figure 10: roundness over X_T/r."""
    figure, [axes] = _row(1, width=7.0, height=4.2)
    ratios = np.array(RATIOS)
    lines = (
        ("full", BLUE, "-", "with play"),
        ("without play", ORANGE, "-", "without play"),
        ("linear, play", BLUE, "--", "loops and play only"),
        ("linear", ORANGE, "--", "loops only"),
    )
    for form, colour, style, label in lines:
        curve = found.roundness(form)
        for k, side in enumerate((ratios < 1.0, ratios > 1.0)):
            axes.plot(
                ratios[side], curve[side], style, marker=".", color=colour, lw=1.2, label=label if k == 0 else None
            )
    axes.axvline(1.0, color="black", lw=0.6)
    axes.set_xlabel("X_T/r")
    axes.set_ylabel("roundness / µm")
    axes.set_ylim(0.0, None)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    axes.set_title("Fig. 10: r = 50 mm, F = 1000 mm/min", fontsize=10)
    return figure


def eccentric_traces(found: Simulations) -> Figure:
    """Figures 12 and 13: traces with the C axis 30 µm off, raw."""
    figure, both = _row(2, width=5.0)
    lap = found.laps[0.9, "full"]
    for axes, name in zip(both, "xy", strict=True):
        for size, colour in ((0.0, GREY), (30.0, BLUE), (-30.0, ORANGE)):
            trace = lap.trace(**{f"d{name}_um": size})
            axes.plot(trace.deg, trace.um, color=colour, lw=0.9, label=f"d{name} = {size:+g} µm" if size else "centred")
        _over_phi(axes)
        axes.set_ylabel("deviation / µm")
        axes.legend(fontsize=8)
    figure.suptitle("Fig. 12 and 13: X_T/r = 0.9; at dx = +30 µm the peak at 180° is concealed", fontsize=10)
    return figure


def eccentricity(found: Simulations) -> Figure:
    """Figure 14: roundness over eccentricity, raw and with the circle taken out."""
    figure, both = _row(2)
    for axes, fitted, title in zip(
        both, (False, True), ("raw readings", "least-squares circle taken out"), strict=True
    ):
        for name, colour in (("x", BLUE), ("y", ORANGE)):
            axes.plot(ECCENTRIC_UM, found.eccentric(axis=name, fitted=fitted), ".-", color=colour, label=f"d{name}")
        axes.set_xlabel("eccentricity / µm")
        axes.set_ylabel("roundness / µm")
        axes.set_ylim(0.0, 80.0)
        axes.set_title(title, fontsize=9)
        axes.grid(alpha=0.3)
    both[0].legend(fontsize=8)
    figure.suptitle("Fig. 14: X_T/r = 0.9; dy tells more than dx only once the circle is out", fontsize=10)
    return figure


def beside(comparisons: Sequence[tuple[str, Comparison]]) -> Figure:
    """symfive beside the paper's drives, and what is between them."""
    figure, (left, right) = _row(2, width=5.0)
    name, whole = comparisons[-1]
    order = np.argsort(whole.deg)
    left.plot(whole.deg[order], whole.theirs[order], color=ORANGE, lw=2.4, alpha=0.5, label="the paper's drives")
    left.plot(
        whole.deg[order], (whole.ours + whole.play_um)[order], color=BLUE, lw=0.8, label="symfive, C turned by b/2"
    )
    left.set_ylabel("deviation / µm")
    left.set_title(name, fontsize=9)
    left.legend(fontsize=8)
    for (label, one), colour in reversed(list(zip(comparisons, (BLACK, ORANGE, GREEN, RED, BLUE), strict=True))):
        order = np.argsort(one.deg)
        right.plot(one.deg[order], one.left_um[order], color=colour, lw=0.9, label=label)
    right.set_ylabel("symfive less the paper's drives / µm")
    right.legend(fontsize=8)
    for axes in (left, right):
        _over_phi(axes)
    return figure


def concealed(view: View, true: Trace) -> Figure:
    """The eccentric machine's trace: raw, with the circle taken out, and its drives' own part uncovered."""
    figure, both = _row(2, width=5.2)
    recovered = view.recovered
    both[0].plot(view.raw.deg, view.raw.um, color=GREY, lw=0.9)
    both[0].set_title("what the ball bar reads, dx = +30 µm", fontsize=9)
    circle = view.raw.without_circle()
    both[1].plot(circle.deg, circle.um, color=ORANGE, lw=0.9, label="least-squares circle taken out")
    both[1].plot(recovered.deg, recovered.um, color=BLUE, lw=0.9, label="diagnosed geometry and play taken out")
    both[1].plot(true.deg, true.um, color="black", lw=0.7, ls="--", label="the same machine, centred")
    figure.legend(*both[1].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8)
    both[1].set_ylim(-20.0, 20.0)
    both[1].set_title("what is made of it", fontsize=9)
    for axes in both:
        _over_phi(axes)
        axes.set_ylabel("deviation / µm")
    return figure


def information(curve: Curve) -> Figure:
    """Expected 1σ of C's gain and play over X_T/r."""
    figure, both = _row(2)
    rows = (
        (both[0], curve.gain, "1σ of C's position gain / (1/s)", range(1, 10)),
        (both[1], curve.play, "1σ of C's play / µrad", (1, 2, 5)),
    )
    for axes, values, label, labelled in rows:
        for side in (curve.ratio < 1.0, curve.ratio > 1.0):
            axes.plot(curve.ratio[side], values[side], ".-", color=BLUE)
        axes.plot(0.9, values[np.argmin(np.abs(curve.ratio - 0.9))], "s", color=ORANGE, label="the paper's 0.9")
        axes.plot(curve.ratio[np.argmin(values)], values.min(), "o", color=GREEN, label="best")
        axes.axvspan(curve.ratio[curve.ratio < 1.0].max(), curve.ratio[curve.ratio > 1.0].min(), color=GREY, alpha=0.25)
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=labelled))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("")
        axes.set_xlabel("X_T/r")
        axes.set_ylabel(label)
        axes.grid(alpha=0.3, which="both")
    both[0].legend(fontsize=8)
    title = f"r = 50 mm, F = {curve.feed:g} mm/min, both directions, eccentricity unknown; grey: C cannot follow"
    figure.suptitle(title, fontsize=10)
    return figure
