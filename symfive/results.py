"""The files that identification and diagnosis leave in a folder of results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from symfive.campaign import write_campaign_files
from symfive.identify import Identification, fitted_model
from symfive.model import write_model
from symfive.outputs import write_json

if TYPE_CHECKING:
    from symfive.diagnose import Diagnosis

Progress = Callable[[str], None]


def write_identification(
    result: Identification, folder: Path, *, figures: bool = True, progress: Progress = lambda message: None
) -> None:
    """identification.json, model.json and, with `figures`, the page and its figures."""
    write_json(folder / "identification.json", result.to_data())
    write_model(fitted_model(result), folder / "model.json")
    if figures:
        from symfive.report import identification_report

        progress("drawing the figures")
        identification_report(result, folder, figures=folder / "figures")


def write_diagnosis(
    result: Diagnosis, folder: Path, *, nc: tuple[str, ...] = ("iso",), progress: Progress = lambda message: None
) -> None:
    """diagnosis.json, the plans of the next tests with programs in the `nc` dialects and set-up sheets, the identification
    with the findings, the page and its figures. A machine without a linear axis has nothing that draws the tool back: the
    plan of its test is the campaign alone."""
    from symfive.design import write_test
    from symfive.report import diagnosis_report

    write_json(folder / "diagnosis.json", result.to_data())
    for finding in result.findings:
        if finding.next_test is not None and finding.test is not None:
            if result.after.model.machine.linear_axes:
                write_test(finding.test, folder / finding.next_test, nc)
            else:
                write_campaign_files(finding.test.test, folder / finding.next_test)
    write_identification(result.after, folder, figures=False)
    progress("drawing the figures")
    diagnosis_report(result, folder)
