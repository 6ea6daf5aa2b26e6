"""Sections of the pages: the numbers that standards ask for, and what each correction is worth."""

from __future__ import annotations

import math
from collections.abc import Sequence

from markupsafe import Markup

from symfive.effects import Effect
from symfive.identify import Identification
from symfive.numbers import rounded, unit_words
from symfive.report._page import fragment
from symfive.report._tables import Cell, table
from symfive.standards import squareness_values, standard_values
from symfive.worth import LONGEST, effect_worths, location_worths, signed

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
        "corrected alone",
        "of the readings' deviation",
        "of a circle's, at most",
        "of the error at the tool",
        "advice",
    ]
    head = Markup('<h2 id="worth">What a correction is worth</h2>\n')
    return head + table("Share of the rms that disappears; negative: it grows", heads, rows)


def _share(share: float | None) -> Cell:
    known = share is not None and math.isfinite(share)
    return Cell(signed(share), share) if known and share is not None else Cell("–", math.nan)
