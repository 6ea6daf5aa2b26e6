"""Plans for a part: its error along the path agrees with the model and an independent chain, falls, and is said everywhere."""

import html
import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import plant
import pytest
from lean import location_only
from make_parts import PARTS, write_parts

from symfive.campaign import SetupSigma
from symfive.cli import main
from symfive.design import Part, Plan, plan
from symfive.errors import InputError
from symfive.identify import identify
from symfive.machine import Machine, preset
from symfive.simulate import simulate
from symfive.toolpath import ToolPath, read_tool_path

FIVE = ("table-bc", "head-bc", "mixed-bc", "nutating-table", "tsutsumi-2007")
QUICK: dict[str, Any] = {"points": 16, "starts": 1, "anywhere": False, "prove": False}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("parts")
    write_parts(preset("table-bc"), found)
    return found


@pytest.fixture(scope="module")
def made(folder: Path) -> Plan:
    return plan(location_only("table-bc"), part=folder / "cone.ngc", minutes=15.0, **(QUICK | {"points": 10}))


def _plant_errors(machine: Machine, part: Part, values: Sequence[float]) -> np.ndarray:
    """Error of the tip (N, 3), µm, by the plant's own chain, of location errors in the order of the part's names."""
    axes = {n: {"origin": list(a.origin), "direction": list(a.direction)} for n, a in machine.axes.items()}
    chain = plant.chain.parse_structure(machine.structure.code, axes)
    q = {n: np.radians(c) if machine.axes[n].rotary else c for n, c in part.commands.items()}
    ball = (0.0, 0.0, -part.path.tool_length)
    errors = {
        n: v * (1e-6 if n[1] in "ABC" else 1e-3) for n, v in zip(part.names, values, strict=True) if "." not in n
    }  # fmt: skip
    return (plant.chain.ball_in_workpiece(chain, q, ball, errors) - plant.chain.ball_in_workpiece(chain, q, ball)) * 1e3


@pytest.mark.parametrize(
    "name", [name if name == "mixed-bc" else pytest.param(name, marks=pytest.mark.slow) for name in FIVE]
)
def test_every_topology_follows_the_parts(name: str, tmp_path: Path) -> None:
    """The tip stands where the words say, and its error is the plant's."""
    machine = preset(name)
    for path in write_parts(machine, tmp_path):
        part = Part(machine, read_tool_path(path, machine))
        axes = {n: {"origin": list(a.origin), "direction": list(a.direction)} for n, a in machine.axes.items()}
        chain = plant.chain.parse_structure(machine.structure.code, axes)
        q = {n: np.radians(c) if machine.axes[n].rotary else c for n, c in part.commands.items()}
        there = plant.chain.ball_in_workpiece(chain, q, (0.0, 0.0, -part.path.tool_length))
        words = np.stack([part.path.position[n] for n in "XYZ"], axis=1)
        np.testing.assert_allclose(there, words, atol=2e-6)
        scale = 1e-2 * part.sigma * np.array(["." not in n for n in part.names])
        predicted = part.slopes @ np.where(scale > 0.0, 1e-2, 0.0)
        np.testing.assert_allclose(_plant_errors(machine, part, scale), predicted, atol=2e-3)


@pytest.mark.parametrize("name", FIVE)
def test_a_touched_datum_takes_its_own_error_out(name: str, tmp_path: Path) -> None:
    """What is left at the datum with the rotary axes at 0 is nothing, elsewhere the difference of two places."""
    machine = preset(name)
    rest = {n: np.zeros(2) for n in machine.axis_names}
    words = rest | {"X": np.array([10.0, 10.0]), "Y": np.array([5.0, 5.0]), "Z": np.array([70.0, 90.0])}
    path = ToolPath(tmp_path, np.array([1, 2]), words, np.array([True, True]), 150.0)
    plain, touched = Part(machine, path), Part(machine, replace(path, datum=(10.0, 5.0, 70.0)))
    np.testing.assert_allclose(touched.slopes[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(touched.slopes[1], plain.slopes[1] - plain.slopes[0], atol=1e-9)


def test_typical_places_stand_for_all(folder: Path) -> None:
    """The worst place among those that designs are compared by is the worst of all within 1 %, for any covariance."""
    machine = preset("table-bc")
    generator = np.random.default_rng(3)
    for name in PARTS:
        part = Part(machine, read_tool_path(folder / f"{name}.ngc", machine))
        assert len(part.typical) <= 150
        for _ in range(5):
            root = generator.standard_normal((len(part.names), 6))
            variance = np.square(part.slopes @ root).sum(axis=(1, 2))
            assert variance[part.typical].max() > 0.98 * variance.max()
            assert part.expected(root @ root.T).worst == pytest.approx(math.sqrt(variance.max()))


@pytest.mark.slow
def test_the_plan_beats_the_ordinary_one_in_the_same_time(made: Plan) -> None:
    both = made.part
    assert both is not None and made.criterion == "G"
    assert both.after.minutes <= 15.0 and both.ordinary.minutes <= 15.0
    assert both.before.worst > 50.0
    assert both.ratio < 0.7  # set-ups averaged and the run-out read: what the D plan leaves
    assert all(run.spindle is not None for run in made.campaign.runs)
    assert "the spindle is indexed" in made.notes[0]


@pytest.mark.slow
def test_what_is_expected_is_what_is_left(made: Plan) -> None:
    """10 machines drawn from the priors, measured and identified: the mean square error along the path is the expected one."""
    both = made.part
    assert both is not None
    part, squares = both.part, 0.0
    for seed in range(10):
        measured = simulate(made.campaign, seed=seed)
        found = identify(measured.campaign, noise="declared")
        left = np.array([measured.truth[n] - found[n] for n in part.names]) / part.sigma
        squares += float(np.square(part.slopes @ left).sum(axis=1).mean()) / 10
    assert 0.6 < math.sqrt(squares) / both.after.expected.mean < 1.4


@pytest.mark.slow
def test_it_is_said_in_plan_json_on_the_sheet_and_on_the_screen(made: Plan, tmp_path: Path) -> None:
    made.write(tmp_path / "plan")
    data = json.loads((tmp_path / "plan" / "plan.json").read_text(encoding="utf-8"))
    part, sheet = data["part"], html.unescape((tmp_path / "plan" / "setup.html").read_text(encoding="utf-8"))
    assert made.part is not None
    assert part["file"] == "cone.ngc" and part["places"] == len(made.part.part.path)
    for key in ("before", "ordinary_d_plan", "this_plan"):
        assert part[key]["worst_um"] >= part[key]["mean_um"] > 0.0
        assert {"line", "X_mm", "C_deg"} <= set(part[key]["worst_at"])
    assert data["certificate"]["part"] == list(made.part.says)
    for sentence in made.part.says:
        assert " ".join(sentence.split()) in " ".join(str(made).split())
    shown = made.part.shown()
    for words in (shown["what"], *shown["notes"], *(cell for row in shown["rows"] for cell in row)):
        assert words in sheet


@pytest.mark.parametrize(("criterion", "tolerance"), [("V", 1e-6), pytest.param("G", 0.03, marks=pytest.mark.slow)])
def test_g_and_v_are_the_worst_and_the_mean_along_the_path(folder: Path, criterion: str, tolerance: float) -> None:
    """ψ of the certificate is twice the logarithm of what is expected along the path; G a p-mean of its typical places."""
    options = QUICK | {"points": 6, "setups": 1, "returns": 0, "index": False, "criterion": criterion}
    found = plan(location_only("table-bc"), part=folder / "pocket.ngc", **options)
    assert found.part is not None
    expected = found.part.after.expected
    size = expected.mean if criterion == "V" else expected.worst
    assert found.certificate.value == pytest.approx(2.0 * math.log(size), abs=tolerance)


@pytest.mark.parametrize(("sigma", "worth"), [(20.0, True), pytest.param(0.1, False, marks=pytest.mark.slow)])
def test_indexing_is_chosen_where_it_pays(folder: Path, sigma: float, worth: bool) -> None:
    """The run-out of 20 µm is worth a pose a run, one of 0.1 µm is not."""
    options = QUICK | {"points": 6, "setups": 1, "setup_sigma": SetupSigma(tool_ball=sigma)}
    found = plan(location_only("table-bc"), part=folder / "cone.ngc", **options)
    assert all((run.spindle is not None) is worth for run in found.campaign.runs)
    assert any("the spindle is indexed" in note for note in found.notes) is worth


@pytest.mark.parametrize(
    ("cut", "said"),
    [
        ("G0 X0 Y0 Z200 B0 C0\nG1 X310\n", "line 2: axis X would be at 302 mm"),
        ("G43.4 H1\nG0 X0 Y0 Z60 B0 C0\nG1 B120\n", "line 3: axis B would be at 112°"),
        ("G43.4 H1\nG0 X0 Y290 Z60 B0 C0\nG1 C180\n", "line 3: axis Y would be at"),
    ],
)
def test_a_path_outside_the_travel_is_refused(tmp_path: Path, cut: str, said: str) -> None:
    (tmp_path / "part.ngc").write_text(cut, encoding="utf-8")
    with pytest.raises(InputError, match=said):
        plan("table-bc", part=tmp_path / "part.ngc", **QUICK)


def test_what_does_not_go_with_a_part(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(folder / "cone.ngc")
    calls = {
        "a part counts every error": ["--part", path, "--for", "EX0C"],
        "does not use the part": ["--part", path, "--criterion", "A"],
        "no use in a plan of circles": ["--part", path, "--circles", "planar", "--effect", "backlash:X"],
        "none is given": ["--part-tool", "120"],
        "is not X,Y,Z": ["--part", path, "--part-zero", "1,2"],
        "there is no such file": ["--part", str(folder / "nothing.ngc")],
    }
    for said, words in calls.items():
        assert main(["plan", "table-bc", "-o", str(tmp_path / "plan"), *words]) == 2
        assert said in capsys.readouterr().err
        assert not (tmp_path / "plan").exists()
