"""Numbers and units as engineers write them: no more digits than the uncertainty or the unit leaves, no 1e-15, no -0."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

__all__ = [
    "change", "decimals", "enumerated", "expected_ratio", "in_words", "name_words", "percent", "plain_number", "power_of_ten",
    "rounded", "unit_words", "with_std", "with_unit",
]  # fmt: skip

RESOLUTION = {"um": 1e-4, "urad": 1e-4, "mm": 1e-6, "deg": 1e-7, "s": 1e-7, "%": 1e-4, "1": 1e-6}
"""What is smaller in this unit is 0 to any machine tool; `1`: directions, gains."""
NOTHING = 1e-12
"""What is smaller in other units is rounding of the computer."""
FEW_DOF = 20.0


def plain_number(value: float, unit: str = "") -> str:
    """Three significant digits at most, or a whole number below 10⁵, without an exponent where it can be avoided; 0 below the
    unit's resolution."""
    value = float(value)
    if abs(value) < RESOLUTION.get(unit.replace("µ", "u"), NOTHING):
        return "0"
    if 1e-3 <= abs(value) < 1e5:
        text = f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}"
        text = text.rstrip("0").rstrip(".") if "." in text else text
    else:
        text = f"{value:.2e}"
    return text.replace("-", "−")


def decimals(std: float) -> int:
    """Decimals that show two digits of an uncertainty above 0; of 0.0996, which is 0.10, they are two."""
    return 1 - math.floor(math.log10(float(f"{std:.1e}")))


def rounded(value: float, std: float, unit: str = "") -> str:
    """A value to the digits that its uncertainty leaves: two of the 1σ; a plain number where `std` is 0."""
    if not _counts(std, unit):
        return plain_number(value, unit)
    digits = decimals(std)
    if digits < -6:
        return f"{value:.4g}".replace("-", "−")
    text = f"{round(value, digits):.{max(digits, 0)}f}"
    return (text.lstrip("-") if float(text) == 0.0 else text).replace("-", "−")


def with_std(value: float, std: float, unit: str = "") -> str:
    """Value ± 1σ with its unit, as `8.90 ± 0.06 µm`; without the 1σ where there is none or it is below the unit's resolution."""
    spread = f" ± {rounded(std, std, unit)}" if _counts(std, unit) else ""
    words = unit_words(unit)
    return f"{rounded(value, std, unit)}{spread}{f' {words}' if words not in ('', '1') else ''}"


def with_unit(value: float, unit: str) -> str:
    """A plain number with its unit, as `8.9 µm`."""
    return with_std(value, 0.0, unit)


def in_words(value: Any, std: Any = None, unit: str = "", *, spread: bool = True) -> str:
    """A quantity: words as they are, a number with its 1σ, several numbers in brackets, each with its own if `spread`."""
    if isinstance(value, str):
        return value
    if not isinstance(value, tuple):
        return with_std(float(value), _spread(std), unit)
    if all(isinstance(v, str) for v in value):
        return ", ".join(value)
    words = unit_words(unit)
    return f"{_listed(value, std, unit, spread)}{f' {words}' if words not in ('', '1') else ''}"


def _listed(value: Any, std: Any, unit: str, spread: bool) -> str:
    if not isinstance(value, tuple):
        if not isinstance(value, (int, float)):
            return str(value)
        own = _spread(std)
        return rounded(value, own, unit) + (f" ± {rounded(own, own, unit)}" if spread and _counts(own, unit) else "")
    spreads = std if isinstance(std, tuple) else (std,) * len(value)
    return f"({', '.join(_listed(v, s, unit, spread) for v, s in zip(value, spreads, strict=False))})"


def _counts(std: float, unit: str) -> bool:
    """Whether a 1σ is more than nothing in its unit."""
    return std > RESOLUTION.get(unit.replace("µ", "u"), NOTHING)


def _spread(std: Any) -> float:
    return float(std) if isinstance(std, (int, float)) else 0.0


def change(before: float, after: float, unit: str = "") -> str:
    """Two numbers as `1.67 → 0.402`, or one where they are written alike; without the unit."""
    old, new = plain_number(before, unit), plain_number(after, unit)
    return new if old == new else f"{old} → {new}"


def percent(share: float) -> str:
    """A share in percent; what rounds to all or none says that it is more or less."""
    if share >= 0.999:
        return "above 99.9 %"
    if share < 1e-3:
        return "0 %" if share <= 0.0 else "below 0.1 %"
    return f"{100.0 * share:.3g} %"


def unit_words(unit: str) -> str:
    """A unit of the files as one writes it: `um` µm, `urad/deg` µrad/°, `um/(m/s^2)` µm/(m/s²)."""
    unit = re.sub(r"\bum\b", "µm", unit)
    unit = re.sub(r"\burad\b", "µrad", unit)
    return re.sub(r"\bdeg\b", "°", unit).replace("^2", "²").replace("*", "·")


def name_words(name: str, unit: str | None) -> str:
    """A quantity's name as words, without the unit that stands behind the number: of `ppm` nothing."""
    return f"_{name}".removesuffix(f"_{(unit or '').lower()}").replace("_", " ").strip()


def enumerated(words: Sequence[str]) -> str:
    """As `a, b and c`."""
    *first, last = words
    return f"{', '.join(first)} and {last}" if first else last


def power_of_ten(p: float) -> str:
    """A probability; small ones as a power of ten."""
    if p >= 1e-3:
        return f"{p:.2g}"
    exponent = math.log10(max(p, 1e-300))
    digits = str(abs(math.floor(exponent))).translate(str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"below 10⁻{digits}" if exponent <= -299.0 else f"about 10⁻{digits}"


def expected_ratio(dof: float) -> str:
    """What noise alone makes of χ²/dof: 1 ± 2 √(2/dof), two standard deviations of χ² over its mean."""
    if not dof >= 1.0:
        return "no degree of freedom is left to judge it"
    said = f"noise alone gives 1 ± {2.0 * math.sqrt(2.0 / dof):.2g}"
    return said + (f"; with {dof:.0f} degrees of freedom it says little" if dof < FEW_DOF else "")
