"""The paper's figures, redrawn from our recordings. Deviations are magnified 10,000 times where geometry is shown."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from examples.panels import BLUE, GREEN, GREY, ORANGE, panels
from symfive.diagnose import Diagnosis

from . import equations as paper
from .machine import B_DEG, C_DEG, NESTS, Concealed, nests_of_the_paper
from .steps import B_ANGLES, C_ANGLES, ORIGIN, TO_FILE, Comparison, ErrorMap, in_the_paper_gauge

Array = NDArray[np.float64]
MAGNIFIED = 10_000
SYMBOLS = ("dx", "dy", "dz", "α", "β", "γ")


def _unit(k: int) -> str:
    return "µm" if k < 3 else "µrad"


def error_functions_b(found: ErrorMap, jointly: Array, hidden: Concealed) -> Figure:
    """E(B): the paper's map, the joint estimate, what is true, and the truth in the gauge of the paper."""
    figure, axes = panels(2, 3, 10.5, 6.0, "Fig. 6: errors of B; dz and γ at B = 0 are set to zero, not measured")
    fine = np.linspace(-90.0, 90.0, 91)
    truth, nodes = hidden.values("B", fine), in_the_paper_gauge(hidden.values("B", B_DEG))
    for k, ax in enumerate(axes.ravel()):
        ax.plot(fine, truth[:, k], color=GREY, label="true")
        ax.plot(B_DEG, nodes[:, k], ":", color=GREY, label="true, in the paper's gauge")
        ax.plot(B_DEG, TO_FILE[k] * found.of_b[:, k], "o", color=BLUE, ms=5, label="(10)–(15)")
        ax.plot(B_DEG, jointly[:, k], "x", color=ORANGE, ms=6, label="B and C at once")
        ax.set_title(f"{SYMBOLS[k]}_BY", loc="left", fontsize=9)
        ax.set_ylabel(_unit(k), fontsize=8)
        ax.set_xticks(B_DEG[::3])
        _at_least(ax, 4.0 if k < 3 else 20.0)
    for ax in axes[1]:
        ax.set_xlabel("B / °", fontsize=8)
    axes[0, 0].legend(fontsize=7.5, frameon=False)
    return figure


def _at_least(ax: Axes, span: float) -> None:
    """No panel shows less than `span`, so that noise does not look like an error function."""
    low, high = ax.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        ax.set_ylim(middle - 0.5 * span, middle + 0.5 * span)


def error_functions_bc(found: ErrorMap, hidden: Concealed) -> Figure:
    """Errors of C over C, one line per B; γ_CB is set to zero."""
    figure, axes = panels(
        1,
        5,
        13.0,
        3.4,
        "Fig. 7: errors of C over C, a line for every B (22); noise of the reference pose returns as a first harmonic",
    )
    fine = np.linspace(0.0, 330.0, 111)
    truth = hidden.values("C", fine)
    for k, ax in enumerate(axes.ravel()):
        for i, b in enumerate(B_DEG):
            strong = b in (-90.0, 0.0, 90.0)
            colour = {-90.0: ORANGE, 0.0: BLUE, 90.0: GREEN}.get(float(b), "#c3cad1")
            ax.plot(
                C_DEG, TO_FILE[k] * found.of_c[i, :, k], color=colour, lw=1.2 if strong else 0.8,
                label=f"B = {b:+.0f}°" if strong else None,
            )  # fmt: skip
        ax.plot(fine, truth[:, k], color="#3c4650", lw=1.6, ls="--", label="true")
        ax.set_title(f"{SYMBOLS[k]}_CB / {_unit(k)}", loc="left", fontsize=9)
        ax.set_xlabel("C / °", fontsize=8)
        ax.set_xticks([0, 90, 180, 270])
    axes[0, 0].legend(fontsize=7, frameon=False)
    return figure


def table_positions(found: ErrorMap, hidden: Concealed, displacement: Array) -> Figure:
    """Figures 5 and 8: the nest at B = 0 and 90°, deviations magnified: measured, and by the errors of B alone (23).

    `displacement` (7, 12, 3) mm of the first nest from the pose B = C = 0. The table is where the ball is, the other way round.
    """
    title = f"Fig. 5, 8: the nest on the table, deviations × {MAGNIFIED:,}; between measured and true lies the gauge"
    figure, axes = panels(2, 2, 10.0, 9.4, title)
    nest = nests_of_the_paper(NESTS[:1])[0]
    true_b, true_c = hidden.values("B", B_DEG) / TO_FILE, hidden.values("C", C_DEG) / TO_FILE
    closed = np.append(np.arange(len(C_DEG)), 0)
    for row, i in enumerate((ORIGIN, len(B_DEG) - 1)):
        b = B_ANGLES[i]
        nominal = paper.table_position(np.zeros(6), b, C_ANGLES, nest)
        tilted = paper.homogeneous(np.zeros(6), b, "y")[:3, :3]
        ball = paper.from_reference(displacement[i], found.of_b[ORIGIN], nest)
        lines = (
            (nominal - np.einsum("ij,njk,nk->ni", tilted, paper.rotation_c(C_ANGLES), ball), "measured", BLUE, "-"),
            (paper.table_position(found.of_b[i], b, C_ANGLES, nest), "errors of B alone, (23)", ORANGE, "-"),
            (paper.table_position(true_b[i], b, C_ANGLES, nest, true_c), "true", "#3c4650", "--"),
        )
        # seen along Y in the machine, and along the C axis on the table
        for ax, view, v in ((axes[row, 0], np.eye(3), 2), (axes[row, 1], tilted.T, 1)):
            flat = (nominal @ view.T)[closed]
            ax.plot(flat[:, 0], flat[:, v], color="#b3bbc3", marker=".", ms=4, lw=0.9, label="commanded")
            for points, label, colour, style in lines:
                drawn = ((nominal + MAGNIFIED * (points - nominal)) @ view.T)[closed]
                ax.plot(drawn[:, 0], drawn[:, v], style, color=colour, lw=1.1, label=label)
            ax.set_aspect("equal", adjustable="datalim")
        axes[row, 0].set_title(f"B = {B_DEG[i]:.0f}°, on the X-Z plane", loc="left", fontsize=9)
        axes[row, 1].set_title(f"B = {B_DEG[i]:.0f}°, on the table's surface", loc="left", fontsize=9)
        for ax, across, up in ((axes[row, 0], "X", "Z"), (axes[row, 1], "x of the table", "y of the table")):
            ax.set_xlabel(f"{across} / mm from the intersection of the axes", fontsize=8)
            ax.set_ylabel(f"{up} / mm", fontsize=8)
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=8, frameon=False
    )
    return figure


def gravity(found: Diagnosis, sag_um: float) -> Figure:
    """A sag in truth, as the plain fit of location errors sees it, and what the two fits leave."""
    figure, axes = panels(1, 2, 11.0, 3.8, "A table that only sinks by its weight, fitted with location errors")
    fine = np.linspace(-90.0, 90.0, 91)
    before, after = found.before, found.after
    axes[0, 0].plot(fine, sag_um * (1.0 - np.cos(np.radians(fine))), color=GREY, lw=2.0, label="true sag")
    axes[0, 0].axhline(before["EZ0B"], color=ORANGE, label=f"believed: EZ0B = {before['EZ0B']:.1f} µm at every B")
    for finding in found.findings:
        size = finding.parameters.get("amplitude")
        if finding.name == "gravity_sag" and size is not None and isinstance(size.value, float):
            curve = size.value * (1.0 - np.cos(np.radians(fine)))
            axes[0, 0].plot(fine, curve, "--", color=BLUE, label=f"diagnosed: {size.value:.2f} µm · (1 - cos B)")
    axes[0, 0].set_ylabel("table along Z / µm", fontsize=8)
    axes[0, 0].legend(fontsize=8, frameon=False)
    for result, colour, what in ((before, ORANGE, "location errors"), (after, BLUE, "with what was diagnosed")):
        run = result.model.campaign.runs[0]
        spread = 1.0 if result is before else -1.0
        residual = result.residuals[run.id]
        axes[0, 1].plot(
            -run.commands["B"] + 2.0 * spread, residual[:, 0], ".", ms=3, color=colour,
            label=f"{what}: {result.rms_um:.2f} µm rms",
        )  # fmt: skip
    axes[0, 1].set_ylabel("x residual of the first nest / µm", fontsize=8)
    axes[0, 1].legend(fontsize=8, frameon=False, loc="upper left")
    for ax in axes.ravel():
        ax.set_xlabel("B / °", fontsize=8)
        ax.set_xticks(B_DEG)
    axes[0, 1].margins(y=0.25)
    return figure


def compensation(b_deg: Array, before: Array, after: Array) -> Figure:
    """Volumetric deviation at poses half-way between those of the map, µm, before and after compensation."""
    figure, axes = panels(1, 1, 6.5, 3.6, "Between the poses of the map, in another place: what compensation leaves")
    ax = axes[0, 0]
    for deviation, colour, shift, what in ((before, ORANGE, -2.0, "before"), (after, BLUE, 2.0, "after")):
        size = np.linalg.norm(deviation, axis=1)
        rms = float(np.sqrt(np.mean(size**2)))
        ax.plot(b_deg + shift, size, ".", color=colour, label=f"{what}: {rms:.2f} µm rms")
    ax.set_xlabel("B / °", fontsize=8)
    ax.set_ylabel("deviation from the reference pose / µm", fontsize=8)
    ax.legend(fontsize=8, frameon=False)
    return figure


def plans(found: Comparison) -> Figure:
    """Expected 1σ of every error: the paper's grid and the optimised plan."""
    names = list(found.ratio)
    title = f"Expected 1σ: {found.grid_rows} poses of the grid and {found.plan_rows} rows of the optimised plan"
    figure, axes = panels(1, 1, 12.0, 3.8, title)
    ax, x = axes[0, 0], np.arange(len(names))
    ax.semilogy(
        x, [found.grid.sigma[n] for n in names], "o", ms=4, color=ORANGE, label=f"grid, {found.grid_minutes:.0f} min"
    )
    ax.semilogy(
        x, [found.plan.sigma[n] for n in names], "x", ms=5, color=BLUE, label=f"plan, {found.plan_minutes:.0f} min"
    )
    ax.set_xticks(x, names, rotation=90, fontsize=6.5)
    ax.set_ylabel("1σ / µm or µrad", fontsize=8)
    ax.legend(fontsize=8, frameon=False)
    return figure
