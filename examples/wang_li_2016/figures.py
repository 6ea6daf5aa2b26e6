"""The paper's figures, redrawn from our readings, and what it does not show: both methods over a thousand machines."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from examples.panels import BLUE, GREEN, GREY, ORANGE, panels
from symfive.campaign import Campaign
from symfive.design import Assessment
from symfive.identify import Identification
from symfive.kinematics import basis_of

from . import equations as paper
from .b_motions import COMBINED, OneTurned
from .estimators import six_motions
from .grid_claims import LAYOUTS, SCALE_MM
from .machine import angle, readings_of
from .machines import Fate
from .screw import LEAD_MM, SIZE_UM, Screw

Array = NDArray[np.float64]


def _pointwise(campaign: Campaign, axis: str) -> tuple[Array, Array]:
    """Positions of an axis (N,) mm and its six error motions by (10) (N, 6) µm and µrad."""
    readings = {run.id: np.stack(list(run.readings.values()), axis=1)[None] for run in campaign.runs}
    nominal = readings_of(campaign, {}, 1)
    found = six_motions(campaign, axis, {run: y - nominal[run] for run, y in readings.items()})[0]
    name = next(run.id for run in campaign.runs if run.id.startswith(f"{axis.lower()}-line1"))
    return campaign.run(name).commands[axis], found * np.array([1e3] * 3 + [1e6] * 3)


def _curve(result: Identification, name: str, q: Array) -> tuple[Array, Array, Array]:
    """An identified error motion at positions (N,), its functions (N, k) and its 1σ (N,)."""
    basis = basis_of(result.model.machine.errors[name], result.model.machine)
    where = [result.model.index[f"{name}.{n}"] for n in basis.names]
    matrix = basis.matrix(q)
    free = _without_line(matrix, q, name)
    std = np.sqrt(np.einsum("ij,jk,ik->i", free, result.covariance[np.ix_(where, where)], free))
    return free @ result.values[where], free, std


def _without_line(values: Array, q: Array, name: str) -> Array:
    """Less the constant, which is a zero, and for straightness less the least-squares line, which is squareness."""
    straight = name[1] in "XYZ" and name[1] != name[2]
    columns = np.column_stack([np.ones_like(q), q] if straight else [np.ones_like(q)])
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])


def six_error_motions(
    campaign: Campaign, result: Identification, truth: Mapping[str, float], axis: str = "X"
) -> Figure:
    """Six error motions of an axis: true, by (10) point by point, and by the joint estimate with ±1σ."""
    figure, axes = panels(2, 3, 11.0, 5.6, f"Error motions of {axis} from three lines; straightness about its own line")
    q, pointwise = _pointwise(campaign, axis)
    for k, ax in enumerate(axes.ravel()):
        name = f"E{'XYZABC'[k]}{axis}"
        value, functions, std = _curve(result, name, q)
        basis = basis_of(result.model.machine.errors[name], result.model.machine)
        true = functions @ np.array([truth[f"{name}.{n}"] for n in basis.names])
        ax.plot(q, _without_line(pointwise[:, k], q, name), ".", color=ORANGE, ms=4, label="(10)")
        ax.fill_between(q, value - std, value + std, color=BLUE, alpha=0.2, lw=0)
        ax.plot(q, value, color=BLUE, label="joint, ±1σ")
        ax.plot(q, true, "--", color="#3c4650", label="true")
        ax.set_title(f"{name} / {'µm' if k < 3 else 'µrad'}", loc="left", fontsize=9)
    for ax in axes[1]:
        ax.set_xlabel(f"{axis} / mm", fontsize=8)
    axes[0, 0].legend(fontsize=7.5, frameon=False)
    return figure


def motions_of_b(found: OneTurned) -> Figure:
    """Six error motions of B less {1, cos b, sin b}: true, point by point in sequence, and by the joint estimate with ±1σ."""
    title = "Error motions of B less {1, cos b, sin b}, which location errors and set-ups take"
    figure, axes = panels(2, 3, 11.0, 5.6, title)
    b = np.degrees(found.b)
    for k, (ax, name) in enumerate(zip(axes.ravel(), COMBINED, strict=True)):
        value, std = found.joint[k], found.std[k]
        ax.plot(b, found.sequence[k], ".", color=ORANGE, ms=4, label="in sequence, at every b")
        ax.fill_between(b, value - std, value + std, color=BLUE, alpha=0.2, lw=0)
        ax.plot(b, value, color=BLUE, label="joint, ±1σ")
        ax.plot(b, found.true[k], "--", color="#3c4650", label="true")
        ax.set_title(name, loc="left", fontsize=9)
        ax.set_ylabel("µm" if k < 3 else "µrad", fontsize=8)
    for ax in axes[1]:
        ax.set_xlabel("b of the table / °", fontsize=8)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def cross_grid(campaign: Campaign) -> Figure:
    """Figures 12 and 13: what the cross grid reads, less the nominal readings: both legs of Z-X, and the lines along X."""
    figure, axes = panels(
        2, 3, 11.0, 5.6, "Cross grid, readings less nominal (fig. 12: squareness; fig. 13: lines along X)"
    )
    nominal = readings_of(campaign, {}, 1)

    def deviations(name: str) -> Array:
        run = campaign.run(name)
        return np.asarray(np.stack(list(run.readings.values()), axis=1) - nominal[name][0])

    name = "square-zx"
    run, seen = campaign.run(name), deviations(name)
    half = 1 + int(np.argmax(np.abs(np.diff(run.commands["X"])) > 0.0))  # X stands still on the first leg
    legs = (("Z", slice(0, half), 1, "fig. 12(2): x"), ("X", slice(half, None), 0, "fig. 12(1): z"))
    for ax, (axis, rows, column, title) in zip(axes[0], legs, strict=False):
        q, um = run.commands[axis][rows], seen[rows, column]
        slope, start = np.polyfit(q, um, 1)
        ax.plot(q, um, ".", color=ORANGE, ms=4)
        ax.plot(q, slope * q + start, color=BLUE, label=f"slope {1e3 * slope:.0f} µrad")
        ax.set_title(f"{title} while {axis} moves", loc="left", fontsize=9)
        ax.set_xlabel(f"{axis} / mm", fontsize=8)
        ax.legend(fontsize=8, frameon=False)
    lines = (
        ("fig. 13(1): line 1, x and y", "x-line1-xy", (0, 1), "xy"), ("(2): line 1, z", "x-line1-xz", (1,), "z"),
        ("(3): line 2, x and y", "x-line2-xy", (0, 1), "xy"), ("(4): line 3, x", "x-line3-xz", (0,), "x"),
    )  # fmt: skip
    for ax, (title, name, columns, letters) in zip((axes[0, 2], *axes[1]), lines, strict=True):
        q, seen = campaign.run(name).commands["X"], deviations(name)
        for column, letter in zip(columns, letters, strict=True):
            colour = {"x": ORANGE, "y": BLUE, "z": GREEN}[letter]
            ax.plot(q, seen[:, column] - seen[0, column], ".-", ms=3, lw=0.7, color=colour, label=letter)
        ax.set_title(title, loc="left", fontsize=9)
        ax.set_xlabel("X / mm", fontsize=8)
        ax.legend(fontsize=8, frameon=False)
    for ax in axes[:, 0]:
        ax.set_ylabel("deviation / µm", fontsize=8)
    return figure


def ball_bar(campaign: Campaign) -> Figure:
    """Readings of the five ball-bar tests with the harmonics that (11)-(15) fit to them."""
    figure, axes = panels(1, 5, 13.5, 3.2, "Ball bar: readings and the harmonics of (11)–(15) (fig. 10, 11)")
    titles = {"b-y": "(11) bar along Y", "b-x": "(12) along X", "b-z": "(13) along Z", "c-low": "(14) C, low ball",
              "c-high": "(15) C, high ball"}  # fmt: skip
    for ax, (name, title) in zip(axes.ravel(), titles.items(), strict=True):
        run = campaign.run(name)
        q = angle(run, "B") if name.startswith("b") else angle(run, "C") % (2.0 * np.pi)
        order = np.argsort(q)
        basis, reading = paper.b_basis(q), run.readings["dL_um"]
        fit = basis @ np.linalg.lstsq(basis, reading, rcond=None)[0]
        ax.plot(np.degrees(q), reading, ".", ms=2.5, color=ORANGE, label="read")
        ax.plot(np.degrees(q)[order], fit[order], color=BLUE, label="harmonics")
        ax.set_title(title, loc="left", fontsize=9)
        ax.set_xlabel(f"{'b' if name.startswith('b') else 'c'} of the table / °", fontsize=8)
    axes[0, 0].set_ylabel("reading / µm", fontsize=8)
    axes[0, 0].legend(fontsize=7.5, frameon=False, loc="lower right")
    return figure


def conditioning() -> Figure:
    """Condition number of (10) along the line for three layouts, and of {1, cos b, sin b} over the range of B."""
    figure, axes = panels(1, 2, 10.0, 3.6, "How well the paper's equations are conditioned")
    x = np.linspace(-300.0, 300.0, 121)
    weights = np.array([1.0] * 3 + [1.0 / SCALE_MM] * 3)
    for (spacing, layout), colour in zip(LAYOUTS.items(), (BLUE, ORANGE, GREEN), strict=True):
        condition = [np.linalg.cond(paper.lines_matrix(at, layout) * weights) for at in x]
        words = f"lines {spacing:g} mm apart" if spacing > 10.0 else f"z2 - z1 = {spacing:g} mm"
        axes[0, 0].semilogy(x, condition, color=colour, label=words)
    axes[0, 0].set_xlabel("x_j / mm", fontsize=8)
    axes[0, 0].set_ylabel("condition of (10), angles at 200 mm", fontsize=8)
    axes[0, 0].legend(fontsize=8, frameon=False)
    ends = np.arange(10.0, 111.0, 2.5)
    axes[0, 1].semilogy(
        ends, [np.linalg.cond(paper.b_basis(np.radians(np.linspace(-end, end, 181)))) for end in ends], color=BLUE
    )
    axes[0, 1].set_xlabel("B turns from - to + / °", fontsize=8)
    axes[0, 1].set_ylabel("condition of {1, cos b, sin b}", fontsize=8)
    return figure


def fates(found: Fate) -> Figure:
    """1σ of both methods over many machines, every parameter, and what was known before."""
    names = list(found.spread)
    title = f"{found.count} machines, noise ±2 µm, set-ups off: 1σ of the error of each estimate"
    figure, axes = panels(1, 1, 14.0, 4.4, title)
    ax, x = axes[0, 0], np.arange(len(names))
    ax.semilogy(x, [found.prior[n] for n in names], "_", color=GREY, ms=9, label="known before (prior)")
    ax.semilogy(x, [found.spread[n][0] for n in names], "o", ms=4, color=ORANGE, label="the paper's sequence")
    ax.semilogy(x, [found.flat[n] for n in names], "+", ms=5, color=GREEN, label="joint, priors 100 times as wide")
    ax.semilogy(x, [found.spread[n][1] for n in names], "x", ms=5, color=BLUE, label="joint")
    ax.set_xticks(x, names, rotation=90, fontsize=6.5)
    ax.set_ylabel("µm or µrad", fontsize=8)
    ax.legend(fontsize=8, frameon=False, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1)
    return figure


def plate_yaw(campaign: Campaign, result: Identification, yaw_urad: float) -> Figure:
    """Roll of an axis that does not roll, one plate having yaw: by (10), and by the joint estimate."""
    figure, axes = panels(1, 1, 6.5, 3.8, f"X does not roll; one plate stands {yaw_urad:g} µrad askew")
    ax = axes[0, 0]
    q, pointwise = _pointwise(campaign, "X")
    value, _, std = _curve(result, "EAX", q)
    ax.plot(q, pointwise[:, 3] - pointwise[:, 3].mean(), ".", color=ORANGE, label="EAX by (10)")
    ax.fill_between(q, value - std, value + std, color=BLUE, alpha=0.2, lw=0)
    ax.plot(q, value, color=BLUE, label="joint, the plate's orientation unknown, ±1σ")
    ax.axhline(0.0, ls="--", color="#3c4650", lw=1.0, label="true")
    ax.set_xlabel("X / mm", fontsize=8)
    ax.set_ylabel("roll / µrad", fontsize=8)
    ax.legend(fontsize=8, frameon=False)
    return figure


def screws(found: Screw) -> Figure:
    """What the error motions of X leave of line 1, read every 5 mm and every 2 mm; dashed what is truly there."""
    title = f"A screw error of {SIZE_UM:g} µm, period {LEAD_MM:g} mm: what the error motions of X leave of line 1"
    figure, axes = panels(1, 1, 8.5, 3.6, title)
    ax = axes[0, 0]
    for diagnosis, pitch, colour in ((found.denser, 2.0, BLUE), (found.paper, LEAD_MM, ORANGE)):
        before = diagnosis.before
        run = before.model.campaign.runs[0]
        ax.plot(
            run.commands["X"], before.residuals[run.id][:, 0], ".", ms=4, color=colour, label=f"read every {pitch:g} mm"
        )
    fine = np.linspace(-30.0, 30.0, 601)
    ax.plot(fine, SIZE_UM * np.sin(2.0 * np.pi * fine / LEAD_MM), "--", lw=0.9, color="#3c4650", label="true")
    ax.set_xlim(-30.0, 30.0)
    ax.set_xlabel("X / mm", fontsize=8)
    ax.set_ylabel("residual along X / µm", fontsize=8)
    ax.legend(fontsize=8, frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1)
    return figure


def plans(tests: Assessment, plan: Assessment, words: tuple[str, str]) -> Figure:
    """Expected 1σ of the eight location errors: the paper's five tests and the optimised plan."""
    figure, axes = panels(1, 1, 7.5, 3.8, "Ball bar, set-ups known to 10 µm: expected 1σ")
    ax, x = axes[0, 0], np.arange(len(paper.LOCATION))
    for found, marker, colour, label in ((tests, "o", ORANGE, words[0]), (plan, "x", BLUE, words[1])):
        ax.semilogy(x, [found.sigma[n] for n in paper.LOCATION], marker, color=colour, label=label)
    ax.set_xticks(x, paper.LOCATION, fontsize=8)
    ax.set_ylabel("µm or µrad", fontsize=8)
    ax.legend(fontsize=8, frameon=False)
    return figure
