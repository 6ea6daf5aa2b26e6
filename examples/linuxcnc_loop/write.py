"""results.json, the table in words and the figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from symfive.outputs import write_json, write_text

from .deviation import size
from .figures import save_figures
from .result import Loop, Passage

COMPARED = (
    "Deviation: where the independent plant has the tool centre point with the joints that the control recorded, minus the "
    "place in the programme, in the workpiece frame; distances over three coordinates. The tool is exactly as long as "
    "programmed. *Work offset set*: of each set-up 3 constants are taken out, as by setting its work offset on the workpiece. "
    "*Set-up taken out*: for each set-up also the 3 constants of the ball's place on the tool, which no R-test "
    "can distinguish from geometry. "
    "*Measured*: the readings of the R-test with their own noise and set-up, the same constants fitted to them and taken out; "
    "the last line is for the degrees of freedom left and to be compared with the noise."
)
"""What the figures compare."""


def _row(words: str, figures: Sequence[float]) -> str:
    before, after, other_before, other_after = figures
    return (
        f"| {words} | {before:.1f} | {after:.2f} | {before / after:.0f} | {other_before:.1f} | {other_after:.2f} | "
        f"{other_before / other_after:.0f} |"
    )


def table_of_loop(loop: Loop) -> list[str]:
    """The results of one machine in Markdown."""
    found, sigmas = loop.identification, loop.errors_in_sigmas()
    passages = (loop.before, loop.after, loop.held_out_before, loop.held_out_after)
    kinds = (("true, nothing taken out", "whole"), ("true, work offset set", "true"),
             ("true, set-up taken out", "geometry"), ("measured, set-up taken out", "measured"))  # fmt: skip
    rows = [
        _row(f"{words}: {size_words}", [getattr(getattr(passage, kind), attribute) for passage in passages])
        for words, kind in kinds
        for size_words, attribute in (("rms", "rms"), ("max", "largest"))
    ]
    rows.append(_row("measured, rms of a coordinate", [passage.measured.per_coordinate for passage in passages]))
    parts = [
        ("identified values", "values"),
        ("error motions of a higher order than the model has, drift", "beyond"),
        ("the control: recorded joints against the exact inverse", "control"),
    ]
    after, other = loop.after.rest, loop.held_out_after.rest
    return [
        f"## {loop.machine.name} (`{loop.preset}`, {loop.machine.structure.code})", "",
        f"{loop.control}. {len(loop.after.true.distances)} poses of the plan and {len(loop.held_out_after.true.distances)} "
        "held out; noise "
        f"{loop.noise_um:g} µm; residual of the fit χ²/dof {found.chi2_dof:.2f}; {loop.seconds:.0f} s for the whole loop.", "",
        "| deviation / µm | before | after | times smaller | held out, before | after | times smaller |",
        "| --- | --- | --- | --- | --- | --- | --- |", *rows, "",
        "| what is left with the work offset set, rms / µm | plan's poses | held out |", "| --- | --- | --- |",
        *(f"| {words} | {size(getattr(after, part)):.4f} | {size(getattr(other, part)):.4f} |" for words, part in parts),
        "",
        "| location error | true | identified | 1σ | off by |", "| --- | --- | --- | --- | --- |",
        *(f"| {name} | {true:.1f} | {found[name]:.1f} | {found.uncertainty(name):.1f} | {sigmas[name]:+.1f} σ |"
          for name, true in loop.truth.location_errors.items()), "",
    ]  # fmt: skip


def lines_of_loop(loop: Loop) -> list[str]:
    """The results of one machine for the terminal."""

    def line(name: str, before: Passage, after: Passage, factor: float) -> str:
        return (
            f"  {name}: rms {before.true.rms:.1f} → {after.true.rms:.2f} µm, max {before.true.largest:.1f} → "
            f"{after.true.largest:.2f} µm, {factor:.0f} times smaller; measured {before.measured.per_coordinate:.1f} → "
            f"{after.measured.per_coordinate:.2f} µm a coordinate (noise {loop.noise_um:g})"
        )

    return [
        line("plan's poses", loop.before, loop.after, loop.factor),
        line("held-out poses", loop.held_out_before, loop.held_out_after, loop.held_out_factor),
        f"  of it the control {size(loop.after.rest.control):.3f} µm, identified values "
        f"{size(loop.after.rest.values):.2f} µm, beyond the model {size(loop.after.rest.beyond):.2f} µm",
        f"  {loop.seconds:.0f} s",
    ]


def write_loop(loop: Loop, folder: Path) -> None:
    """Data and figures of one machine."""
    write_json(folder / "results.json", loop.to_data())
    save_figures(loop, folder)


def write_summary(loops: Sequence[Loop], folder: Path) -> None:
    """All machines: results.json and loop.md."""
    write_json(folder / "results.json", {loop.preset: loop.to_data() for loop in loops})
    text = ["# The loop through LinuxCNC", "", COMPARED, ""]
    for loop in loops:
        text += table_of_loop(loop)
    write_text(folder / "loop.md", "\n".join(text))
