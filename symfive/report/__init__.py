"""Figures, reports and printed words of what symfive found.

A name is loaded on first use (PEP 562): who prints a result does not wait for Matplotlib.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from symfive.report._correlation import correlation_matrix
    from symfive.report._diagnosis import diagnosis_report, visible_parts
    from symfive.report._findings import diagnosis_text
    from symfive.report._over_coordinates import residuals_over_coordinates
    from symfive.report._over_time import residuals_over_time
    from symfive.report._parameters import error_motion_bands, parameters_chart
    from symfive.report._polar import polar_trace
    from symfive.report._prediction import prediction_chart
    from symfive.report._report import identification_report, save_figures
    from symfive.report._spectrum import residual_spectrum
    from symfive.report._words import identification_text
    from symfive.report.signature import plot_signature

__all__ = [
    "correlation_matrix", "diagnosis_report", "diagnosis_text", "error_motion_bands", "identification_report",
    "identification_text", "parameters_chart", "plot_signature", "polar_trace", "prediction_chart", "residual_spectrum",
    "residuals_over_coordinates", "residuals_over_time", "save_figures", "visible_parts",
]  # fmt: skip

_MODULES = {
    "correlation_matrix": "_correlation",
    "diagnosis_report": "_diagnosis",
    "diagnosis_text": "_findings",
    "error_motion_bands": "_parameters",
    "identification_report": "_report",
    "identification_text": "_words",
    "parameters_chart": "_parameters",
    "plot_signature": "signature",
    "polar_trace": "_polar",
    "prediction_chart": "_prediction",
    "residual_spectrum": "_spectrum",
    "residuals_over_coordinates": "_over_coordinates",
    "residuals_over_time": "_over_time",
    "save_figures": "_report",
    "visible_parts": "_diagnosis",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES})
