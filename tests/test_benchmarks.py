"""The table of ratios from numbers at hand: ratios, targets, skipped and beaten peers; the peer's fit on a small campaign."""

import subprocess
import sys
from pathlib import Path

import pytest
import rows

BENCHMARKS = Path(__file__).resolve().parent.parent / "benchmarks"

JACOBIAN = {
    "ours": 100.0, "used": 25.0, "used limit": 12.5, "sums": 100.0, "sums limit": 50.0, "past": 115.0, "past limit": 110.0,
    "kept": 100.0, "kept limit": 70.0, "Gflop/s": 70.0, "CasADi compiled": 650.0, "CasADi pairs": 6.6, "CasADi map": 12_000.0,
    "cached": 60.0, "pinocchio: loop": 2400.0, "SymForce: loop": 250.0, "CppADCodeGen: loop": 90.0, "numpy, batched": 1.5e5,
    "JAX: jit": "skipped: ModuleNotFoundError: No module named 'jax'",
}  # fmt: skip
DESIGN = {
    "candidates": (113.2, 0.03), "bound on candidates": (113.3, 0.01), "FIGAROH DETMAX": (113.3, 9.0), "pydex": "skipped: absent",
    "structured": (115.2, 0.11), "automatic": (115.3, 5.5), "L-BFGS": (115.3, 0.22), "best of 50": (115.3, 5.0),
    "bound": (115.35, 1.0),
}  # fmt: skip


def test_jacobian_rows_compare_with_limits_and_peers() -> None:
    made = rows.jacobian_rows(JACOBIAN)
    assert [row.ahead for row in made] == [True, False, True, True, False, True, False, True, False, None, True]
    assert made[0].ratio == "1.05 ×" and made[4].ratio == "6.5 ×" and made[5].ratio == "120 ×"
    assert "median of pairs timed side by side 6.6 ×" in made[4].why and "96 ×" in made[6].why


def test_design_rows_judge_the_design_and_the_time() -> None:
    made = rows.design_rows(DESIGN, 12)
    assert [row.ahead for row in made] == [False, None, True, False, True, False, True, True, True]
    assert made[2].ratio == "50 ×" and made[3].ratio == "2 ×"


def test_growth_rows_fit_the_last_sizes() -> None:
    linear = [(10.0, 5.0), (100.0, 1.0), (1000.0, 10.0), (10_000.0, 100.0)]
    assert rows.exponent(linear) == pytest.approx(1.0)
    by_rows = [{"rows": n, "step": 1e-6 * n, "memory": 1e-9 * n**2, "identify": 1e-5 * n} for n in (1e3, 1e4, 1e5)]
    made = rows.growth_rows({"rows": by_rows, "poses": linear, "parameters": linear, "effects": linear})
    assert [row.ahead for row in made] == [True, None, False, None, None, None]
    assert made[2].ratio == "rows^2.00"


def test_diagnosis_rows_count_wrong_names_and_name_the_quickest_rival() -> None:
    tally = {"right": 3, "false": 0, "missed": 0, "alarms": 0, "seconds": 40.0, "skipped": ""}
    found = {name: tally | {"false": 2, "seconds": 10.0 + i} for i, name in enumerate(rows.RIVALS)}
    found |= {"symfive": tally, "PySINDy": tally | {"skipped": "skipped: absent"}}
    made = rows.diagnosis_rows(found, 6)
    assert [row.ahead for row in made] == [True, True, True, None, False]
    assert made[0].ratio == "0 : 2 wrong" and "plain BIC: 10 s" in made[4].peer


def test_table_is_markdown_and_tells_what_is_behind() -> None:
    text = rows.table([*rows.jacobian_rows(JACOBIAN), *rows.design_rows(DESIGN, 12)], "a machine")
    lines = text.splitlines()
    assert lines[0] == "a machine" and lines[3] == "| what | symfive | peer or limit | ratio | target |"
    table = [line for line in lines if line.startswith("|")]
    assert len(table) == 2 + 20 and {line.count("|") for line in table} == {6}
    assert "JAX, jit: skipped: ModuleNotFoundError" in text
    assert len([line for line in lines if line.startswith("- ✗")]) == sum(line.endswith("✗ |") for line in table) == 7


@pytest.mark.slow
def test_scipy_reaches_the_same_values() -> None:
    import least_squares

    _, count, parameters, fits = least_squares.compare(1000)
    assert count > 900 and parameters == 58
    assert fits["3-point"].distance < least_squares.AGREED and abs(fits["3-point"].excess) < 1e-3


def test_an_unknown_section_is_refused() -> None:
    done = subprocess.run(
        [sys.executable, str(BENCHMARKS / "table.py"), "weather"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and "unknown section: weather" in done.stderr


def test_the_chain_of_the_peers_is_generated() -> None:
    from codegen import c_files, subject

    assert "sf_parameter_jacobian(" in c_files(subject(), "sf")["sf.c"]
