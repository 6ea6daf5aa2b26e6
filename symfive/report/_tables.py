"""HTML tables: every cell escaped, numbers aligned and sortable by their exact value; the sections of the numbers that standards
ask for and of what each correction is worth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from symfive.campaign import FIRST_LINE
from symfive.effects import Effect
from symfive.identify import Identification
from symfive.inference import square_of
from symfive.numbers import plain_number, rounded, unit_words
from symfive.report._page import fragment
from symfive.report._traces import traces_of
from symfive.report._words import WAVES, determined, stated
from symfive.runs import instrument_words
from symfive.standards import squareness_values, standard_values
from symfive.worth import LONGEST, effect_worths, location_worths, signed

MOST_OUTLIERS = 500
LONG = 48


@dataclass(frozen=True)
class Cell:
    """A number: `text` as shown, `value` to sort by."""

    text: str
    value: float

    @property
    def sortable(self) -> bool:
        """Whether it is a number; the others keep their place when sorted by text."""
        return math.isfinite(self.value)


def table(
    caption: str, heads: Sequence[str], rows: Sequence[Sequence[str | Cell]], classes: Sequence[str] = ()
) -> Markup:
    """A sortable table. `heads`, `caption` and text cells are plain text; `classes` one class per row."""
    marked = [{"cells": row, "mark": classes[i] if i < len(classes) else ""} for i, row in enumerate(rows)]
    return fragment("table", caption=caption, heads=heads, rows=marked, long=LONG)


def parameter_table(identification: Identification) -> Markup:
    """Machine and effects: value, 1σ, 95 % interval, unit, prior."""
    rows: list[list[str | Cell]] = []
    found = list(stated(identification))
    for each in found:
        state = (
            "held fixed" if each.std == 0.0 else "improved on the prior" if each.known else "no better than the prior"
        )
        numbers = [Cell("–", math.nan)] * 3
        if not each.is_open:
            value, std, low, high = (rounded(v, each.std, each.unit) for v in (each.value, each.std, *each.interval))
            numbers = [Cell(value, each.value), Cell(std, each.std), Cell(f"{low} … {high}", each.interval[0])]
        prior = Cell("–", math.nan)
        if each.prior is not None:
            mean, sigma = each.prior
            prior = Cell(f"{plain_number(mean, each.unit)} ± {plain_number(sigma)}", sigma)
        rows.append([each.symbol, each.meaning, *numbers, unit_words(each.unit), prior, state])
    heads = ["error", "meaning", "value", "1σ", "95 % interval", "unit", "prior (mean ± 1σ)", "the readings"]
    caption = "Parameters of the machine and its effects"
    waves = f". {WAVES}" if any(each.prior is None for each in found) else ""
    return table(caption + waves, heads, rows, ["" if each.known else "weak" for each in found])


def noise_table(identification: Identification) -> Markup:
    """Per run and instrument: noise declared and found, what the residuals are."""
    rows: list[list[str | Cell]] = []
    found = traces_of(identification)
    for key in dict.fromkeys((t.run.id, t.instrument) for t in found):
        traces = [t for t in found if (t.run.id, t.instrument) == key]
        run, noise, unit = traces[0].run, traces[0].noise, traces[0].unit
        every = np.zeros((run.rows, 1), dtype=bool)
        rms = math.sqrt(sum(square_of(t.residual[:, None], every) for t in traces) / (len(traces) * run.rows))
        slow = noise.coloured > 0.0
        size = _number(noise.coloured, unit) if slow else Cell("none", 0.0)
        tau = _number(noise.time_constant, "s") if slow else Cell("–", 0.0)
        if noise.decades > 1:
            tau = Cell(f"{_number(noise.times[-1], 's').text} to {tau.text}", tau.value)
        if slow and not run.has_clock:
            tau = Cell(f"{tau.text} rows", tau.value)
        words = [run.id, instrument_words(traces[0].instrument), run.sampling]
        numbers = [
            Cell(str(run.rows), run.rows),
            _number(noise.declared, unit),
            _number(noise.white, unit),
            size,
            tau,
            _number(rms, unit),
        ]
        rows.append([*words, *numbers, unit_words(unit)])
    heads = ["run", "instrument", "sampling", "rows", "declared 1σ", "white 1σ", "slow 1σ",
             "correlation time / s", "residual RMS", "unit"]  # fmt: skip
    return table("Noise of one reading", heads, rows)


def _number(value: float, unit: str) -> Cell:
    text = f"{value:#.3g}".replace("-", "−") if 1e-3 <= abs(value) < 1e3 else plain_number(value, unit)
    return Cell(text, value)


def outlier_table(identification: Identification) -> Markup:
    """Run, file, row in the file (the header is row 1), column, time, residual, σ."""
    campaign = identification.model.campaign
    units = {(t.run.id, t.column): t.unit for t in traces_of(identification)}
    rows: list[list[str | Cell]] = []
    for o in identification.outliers[:MOST_OUTLIERS]:
        run = campaign.run(o.run)
        time = Cell(f"{run.time[o.row]:.3f}", float(run.time[o.row])) if run.has_clock else Cell("–", math.nan)
        unit, sigmas = unit_words(units.get((o.run, o.column), "")), f"{o.sigmas:.1f}".replace("-", "−")
        rows.append([run.id, run.file, Cell(str(o.row + FIRST_LINE), o.row), o.column, time,
                     _number(o.residual, units.get((o.run, o.column), "")), unit, Cell(sigmas, o.sigmas)])  # fmt: skip
    heads = ["run", "file", "row in the file", "column", "time / s", "residual", "unit", "in σ of the noise"]
    more = len(identification.outliers) - len(rows)
    return table(f"Outliers excluded from the fit{f' (first {len(rows)}; {more} more)' if more else ''}", heads, rows)


def setup_table(identification: Identification) -> Markup:
    """One row per run, one column per set-up quantity: value ± 1σ."""
    entries: dict[str, dict[str, Cell]] = {}
    units: dict[str, str] = {}
    for p in (q for q in identification.parameters if q.of_setup):
        value, std = identification[p.name], identification.uncertainty(p.name)
        known = "" if determined(identification, p) else " *"
        said = f"{rounded(value, std, p.unit)} ± {rounded(std, std, p.unit)}{known}"
        entries.setdefault(p.owner_words, {})[p.what] = Cell(said, value)
        units.setdefault(p.what, unit_words(p.unit))
    rows: list[list[str | Cell]] = []
    for run, found in entries.items():
        rows.append([run, *(found.get(quantity, Cell("–", math.nan)) for quantity in units)])
    first = "run or mounting" if any(p.mounting for p in identification.parameters) else "run"
    heads = [first, *(f"{quantity} / {unit}" if unit != "1" else quantity for quantity, unit in units.items())]
    return table("Set-up of each run: value ± 1σ (* no better than the prior)", heads, rows)


MOST_VALUES, MOST_LIMITS = 200, 40
COMMON = ("tool reference", "evaluation")
"""Conditions that the page does not repeat in every row; `symfive standards` prints them."""


def standards_section(identification: Identification) -> Markup:
    """G, E, A … with U (k = 2) and what they hold for; nothing where no run is such a test. Long runs are left to `symfive
    standards`: they would have to be held in memory as a whole."""
    campaign = identification.model.campaign
    short = [run.id for run in campaign.runs if run.rows <= LONGEST]
    found = standard_values(campaign.select(*short)) if short else ()
    values = (*found, *squareness_values(identification))[:MOST_VALUES]
    if not values:
        return Markup()
    rows: list[list[str | Cell]] = []
    for value in values:
        known = math.isfinite(value.u)
        number = Cell(rounded(value.value, value.u if known else 0.0, value.unit), value.value)
        spread = Cell(rounded(value.u, value.u, value.unit) if known else "unknown", value.u)
        conditions = "; ".join(f"{key} {said}" for key, said in value.conditions.items() if key not in COMMON)
        rows.append([value.standard, value.title, number, spread, unit_words(value.unit), conditions])
    limits = list(dict.fromkeys(f"{value.title}: {limit}" for value in values for limit in value.limits))[:MOST_LIMITS]
    heads = ["standard", "quantity", "value", "U (k = 2)", "unit", "holds for"]
    shown = table(
        "From the readings alone, independent of the model; squareness (identified) from the model", heads, rows
    )
    return fragment("standards", table=shown, limits=limits)


def worth_section(
    identification: Identification, titles: Sequence[str] = (), effects: Sequence[Effect | tuple[Effect, ...]] = ()
) -> Markup:
    """What disappears with each of the `effects` of the fitted model, under their `titles`, and with each location error, these
    the most at the tool first; nothing where there is neither."""
    found = [*zip(titles, effect_worths(identification, effects), strict=True)] if effects else []
    found += [(", ".join(worth.names), worth) for worth in location_worths(identification)]
    if not found:
        return Markup()
    rows: list[list[str | Cell]] = []
    for name, worth in found:
        best = max(worth.circles.values(), default=math.nan)
        rows.append([name, _share(worth.readings), _share(best), _share(worth.tool), worth.advice])
    heads = [
        "correction",
        "readings",
        "circle, at most",
        "error at the tool",
        "advice",
    ]
    head = Markup('<h2 id="worth">What a correction is worth</h2>\n')
    return head + table("How much each correction alone lowers the rms (negative: raises)", heads, rows)


def _share(share: float | None) -> Cell:
    known = share is not None and math.isfinite(share)
    return Cell(signed(share), share) if known and share is not None else Cell("–", math.nan)
