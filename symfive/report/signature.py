"""A figure of what an effect does to the readings of a campaign."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from symfive.campaign import Campaign, Run
from symfive.effects import Effect
from symfive.instruments import columns_of
from symfive.model import signature

COLOURS = ("#0b5394", "#b45f06", "#38761d", "#741b47", "#666666", "#134f5c")
PANEL = (7.0, 1.7)
"""Width and height of one run's panel, inch."""


def plot_signature(
    effect: Effect, campaign: Campaign, size: Mapping[str, float] | None = None, *, columns: str = ""
) -> Figure:
    """Change of the readings over time, one panel a run, on a common scale.

    `size` as in `symfive.model.signature`; `columns` the ending of the columns to draw (default `_um`, else
    all). Thin lines mark where an axis reverses. The figure belongs to no window: `figure.savefig(…)`.
    """
    change = signature(effect, campaign, size)
    figure = Figure(figsize=(PANEL[0], PANEL[1] * len(campaign.runs) + 0.7), layout="constrained")
    panels = figure.subplots(len(campaign.runs), 1, sharey=True, squeeze=False)[:, 0]
    for panel, run in zip(panels, campaign.runs, strict=True):
        names = [column.name for column in columns_of(run, campaign.machine)]
        _draw(panel, run, change[run.id], names, columns or "_um")
    panels[-1].set_xlabel("time in the run / s")
    title = effect.id.replace("_", " ") + (f" of {effect.axis}" if effect.axis else "")
    figure.suptitle(f"{title}: change of the readings", fontsize=11)
    return figure


def _draw(panel: Axes, run: Run, change: np.ndarray, names: list[str], ending: str) -> None:
    drawn = [i for i, name in enumerate(names) if name.endswith(ending)] or list(range(len(names)))
    style = {"linewidth": 1.2} if run.dynamic else {"linewidth": 0.6, "marker": ".", "markersize": 4.0}
    for colour, i in zip(COLOURS, drawn, strict=False):
        panel.plot(run.time, change[:, i], color=colour, label=names[i].rsplit("_", 1)[0], **style)
    if run.dynamic:
        for name in run.commands:
            for time in _reversals(run, name):
                panel.axvline(time, color="0.8", linewidth=0.7, zorder=0)
    panel.axhline(0.0, color="0.6", linewidth=0.6, zorder=0)
    panel.set_title(run.id, loc="left", fontsize=9)
    panel.set_ylabel(names[drawn[0]].rsplit("_", 1)[-1].replace("um", "µm"))
    panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
    panel.spines[["top", "right"]].set_visible(False)


def _reversals(run: Run, axis: str) -> np.ndarray:
    """Times at which the command of an axis turns round."""
    step = np.sign(np.diff(run.commands[axis]))
    moving = np.flatnonzero(step)
    turned = np.flatnonzero(np.diff(step[moving]) != 0.0)
    return np.asarray(run.time[moving[turned] + 1])
