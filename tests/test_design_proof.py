"""Bounds of what a pose can tell: closed forms, dense sampling, corners; what is no polynomial is not called proved."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from symfive.design import Space, certify, make_space, plan, task_of
from symfive.design._proof import bounded_sensitivity  # the bound itself, of chosen sensitivities
from symfive.machine import ErrorTerm, Machine, Structure, preset
from symfive.optimal import Rows, sensitivity, spectrum_of

LOW, HIGH = np.array([-1.9, -np.pi]), np.array([1.9, np.pi])


def _sample(space: Space, count: int, seed: int) -> np.ndarray:
    """Random poses, poses on edges and all corners."""
    generator = np.random.default_rng(seed)
    poses = generator.uniform(-0.25, 1.25, (count, space.poses)).clip(0.0, 1.0)
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=space.poses)))
    low, high = space.lower[: space.poses], space.upper[: space.poses]
    return np.asarray(low + (high - low) * np.concatenate([poses, corners]))


def _sensitivity(space: Space, pull: np.ndarray, setup: np.ndarray, k: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """⟨G, F⟩ of reachable poses."""
    z = np.concatenate([poses, np.tile(setup, (len(poses), 1))], axis=1)
    lengths = np.tile(k, (len(poses), 1))
    reachable = np.all(space.kernel.limits(z, lengths) >= 0.0, axis=1)
    return sensitivity(pull, space.kernel.rows(z[reachable], lengths[reachable]))


@pytest.mark.parametrize(
    ("name", "expected"),
    [("EX0C", (50.0 / 0.3) ** 2), ("EXC.cos1", (5.0 / 0.3) ** 2), ("EZB.P3", (10.0 / 0.3) ** 2)],
)
def test_the_bound_of_one_error_is_its_closed_form(name: str, expected: float) -> None:
    """A shift of C's axis moves the ball as far at every pose, cos C at most once, a Legendre polynomial most at B = ±110°."""
    machine = preset("table-bc")
    machine = replace(machine, workspace=replace(machine.workspace, spindle_nose=None), text="")
    space = make_space(machine, "r_test")
    task = task_of(space, "D", [p.name for p in space.shared], None)
    layout = task.layout(1)
    pull = np.zeros((layout.size, layout.size))
    i = [p.name for p in space.shared].index(name)
    pull[i, i] = 1.0
    z = np.concatenate([np.zeros(2), [0.0, 0.0, 0.5, 1.2]])
    proved = bounded_sensitivity(space, layout, pull, z, np.zeros(1), 0, 0.9 * expected, 1e-3)
    assert proved is not None
    assert expected * (1.0 - 1e-9) <= proved.bound <= expected * (1.0 + 2e-3)


@pytest.mark.parametrize(
    ("preset_name", "instrument", "slack"),
    [("oyama-2010", "r_test", 0.01), ("three-axis", "ball_bar", 0.01), ("tsutsumi-2007", "ball_bar", 0.3)],
)
def test_no_sampled_pose_tells_more_than_the_bound(preset_name: str, instrument: str, slack: float) -> None:
    space = make_space(preset(preset_name), instrument)
    task = task_of(space, "D", [p.name for p in space.shared], None)
    layout = task.layout(1)
    generator = np.random.default_rng(3)
    root = generator.standard_normal((layout.size, 4))
    pull = root @ root.T
    setup = 0.3 * space.lower[space.poses :] + 0.7 * space.upper[space.poses :]
    k = np.array([space.lengths[-1]])
    z = np.concatenate([np.zeros(space.poses), setup])
    few = _sensitivity(space, pull, setup, k, _sample(space, 500, 0)).max()
    proved = bounded_sensitivity(space, layout, pull, z, k, 0, float(few), slack)
    assert proved is not None
    many = _sensitivity(space, pull, setup, k, _sample(space, 60_000, 1)).max()
    found = max(few, *_sensitivity(space, pull, setup, k, proved.better), 0.0) if len(proved.better) else few
    assert many <= proved.bound
    assert proved.bound <= found * (1.0 + slack) * (1.0 + 1e-6)


def test_derivatives_are_bounded_where_angle_and_travel_mix() -> None:
    """(x³ cos 2x + sin y)² and its third derivatives, by differences on a dense grid."""

    def phi(poses: np.ndarray) -> np.ndarray:
        x, y = poses.T
        return np.asarray((x**3 * np.cos(2.0 * x) + np.sin(y)) ** 2)

    spectrum = spectrum_of(phi, LOW, HIGH)
    assert spectrum is not None
    assert [angle.round for angle in spectrum.angles] == [False, True] and spectrum.angles[1].degree == 2
    x = np.linspace(LOW[0], HIGH[0], 4001)
    value = phi(np.stack([x, np.full_like(x, 0.5 * np.pi)], axis=1))
    step = x[1] - x[0]
    for order, values in ((0, value), (1, np.gradient(value, step)), (3, np.diff(value, 3) / step**3)):
        assert np.abs(values).max() <= spectrum.bounds(order)[(order, 0)] * (1.0 + 1e-6) <= 4.0 * np.abs(values).max()


@pytest.mark.parametrize(
    "bent", [lambda x: 1.0 + np.abs(np.sin(x)), lambda x: np.exp(np.cos(30.0 * x)), lambda x: x.clip(0.5)]
)
@pytest.mark.parametrize("i", [0, 1])
def test_what_is_no_polynomial_is_refused(bent, i: int) -> None:  # type: ignore[no-untyped-def]
    assert spectrum_of(lambda poses: bent(poses[:, 0]), LOW[i : i + 1], HIGH[i : i + 1]) is None


def test_one_rotary_axis_is_proved() -> None:
    """A table C alone has one angle to cover, as a four-axis machine has."""
    of_five = preset("table-bc")
    structure = Structure.parse("w C' X' Y' b Z t")
    axes = {name: of_five.axes[name] for name in structure.axes}
    errors = {name: term for name, term in of_five.errors.items() if name in ("EC0X", "EX0C", "EY0C", "EA0C", "EB0C")}
    machine = replace(of_five, structure=structure, axes=axes, errors=errors, text="")
    made = plan(machine, points=6, starts=1)
    assert made.certificate.proved and made.certificate.efficiency > 0.9


def _with_spline() -> Machine:
    machine = preset("oyama-2010")
    knots = (-180.0, -60.0, 60.0, 180.0)
    spline = ErrorTerm(name="EXC", basis=("bspline",), order=(3,), over=("C",), knots=(knots,), sigma=5.0)
    return replace(machine, errors={**machine.errors, "EXC": spline}, text="")


def test_splines_are_searched_and_the_certificate_says_so() -> None:
    space = make_space(_with_spline(), "r_test")
    task = task_of(space, "D", [p.name for p in space.shared], None)
    poses = _sample(space, 200, 4)
    z = np.concatenate([poses, np.tile([0.5, 0.3, 0.9, 1.5], (len(poses), 1))], axis=1)
    z = z[space.feasible(z, np.zeros((len(z), 1)))][:30]
    certificate = certify(space, task, Rows.of(z, np.zeros((len(z), 1)), np.zeros(len(z), dtype=np.int64), 2))
    assert not certificate.proved and "(searched, not proved)" in certificate.says
