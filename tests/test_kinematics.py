"""Properties of the chain and of the bases that hold for every machine."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from symfive.errors import InputError
from symfive.kinematics import Basis, axis_pose, ball_in_workpiece, basis_of, first_order
from symfive.machine import ErrorTerm, Machine, Structure, make_axis, preset
from symfive.procedures import Nominal

LETTERS = "XYZABC"
numbers = st.floats(-1.0, 1.0, allow_nan=False)
vectors = st.tuples(numbers, numbers, numbers)
slow = settings(max_examples=30, deadline=None)


@st.composite
def machines(draw, least=1, linear=()):
    """Random order, side, direction and origin of up to six axes."""
    chosen = draw(st.lists(st.sampled_from(LETTERS), min_size=least, max_size=6, unique=True))
    names = draw(st.permutations(sorted({*chosen, *linear})))
    bed = draw(st.integers(0, len(names)))
    axes = {}
    for name in names:
        direction = np.asarray(draw(vectors)) * 0.5 + np.eye(3)[LETTERS.index(name) % 3]
        origin = tuple(100.0 * np.asarray(draw(vectors)))
        axes[name] = make_axis(name, direction=tuple(map(float, direction)), origin=tuple(map(float, origin)))
    return Machine(name="any", structure=Structure(tuple(names[:bed]), tuple(names[bed:])), axes=axes)


@st.composite
def poses(draw, machine):
    return {name: draw(numbers) * (3.0 if machine.axes[name].rotary else 200.0) for name in machine.axis_names}


def ball(machine, position, tool, **more):
    symbols = {name: ca.SX(value) for name, value in position.items()}
    return np.asarray(ca.evalf(ball_in_workpiece(machine, symbols, ca.DM(tool), **more)))[:, 0]


def with_structure(machine, workpiece, tool):
    return Machine(name="other", structure=Structure(tuple(workpiece), tuple(tool)), axes=machine.axes)


@slow
@given(st.data())
def test_a_prime_turns_the_sign_and_nothing_else(data):
    """Without errors only the relative motion counts: the bed may stand anywhere in the structural code."""
    machine = data.draw(machines())
    position = data.draw(poses(machine))
    tool = 100.0 * np.asarray(data.draw(vectors))
    order = [*machine.structure.workpiece, *machine.structure.tool]
    for bed in range(len(order) + 1):
        other = with_structure(machine, order[:bed], order[bed:])
        assert ball(other, position, tool) == pytest.approx(ball(machine, position, tool), abs=1e-9)


@slow
@given(st.data())
def test_a_positive_command_moves_the_tool_positively(data):
    """ISO 841: on the tool side A(q) = Trans(e q) or Rot(e, q), whatever side the axis is on."""
    name = data.draw(st.sampled_from(LETTERS))
    q = data.draw(numbers)
    tool = 100.0 * np.asarray(data.draw(vectors))
    axis = make_axis(name)
    expected = tool + np.asarray(axis.direction) * 100.0 * q
    if axis.rotary:
        e, c, s = np.asarray(axis.direction), np.cos(q), np.sin(q)
        expected = c * tool + s * np.cross(e, tool) + (1 - c) * (e @ tool) * e
    for structure in (Structure((name,), ()), Structure((), (name,))):
        machine = Machine(name="one", structure=structure, axes={name: axis})
        assert ball(machine, {name: q if axis.rotary else 100.0 * q}, tool) == pytest.approx(expected, abs=1e-9)


@slow
@given(st.data())
def test_zero_pose_is_the_tool_ball(data):
    machine = data.draw(machines())
    tool = 100.0 * np.asarray(data.draw(vectors))
    assert ball(machine, dict.fromkeys(machine.axis_names, 0.0), tool) == pytest.approx(tool, abs=1e-9)


@slow
@given(st.data())
def test_a_turned_and_shifted_frame_changes_nothing(data):
    """The whole machine turned by Q and shifted by p gives the ball turned by Q and shifted by p."""
    machine = data.draw(machines())
    position = data.draw(poses(machine))
    tool = 100.0 * np.asarray(data.draw(vectors))
    turn, _ = np.linalg.qr(np.asarray(data.draw(st.tuples(vectors, vectors, vectors))) + 3.0 * np.eye(3))
    turn *= np.sign(np.linalg.det(turn))
    shift = 50.0 * np.asarray(data.draw(vectors))
    axes = {
        name: make_axis(
            name,
            direction=tuple(map(float, turn @ axis.direction)),
            origin=tuple(map(float, turn @ axis.origin + shift)),
        )
        for name, axis in machine.axes.items()
    }
    moved = Machine(name="moved", structure=machine.structure, axes=axes)
    expected = turn @ ball(machine, position, tool) + shift
    assert ball(moved, position, turn @ tool + shift) == pytest.approx(expected, abs=1e-8)


@slow
@given(st.data())
def test_inverse_round_trip(data):
    """Linear axes solved for a target bring the ball there, whatever stands between them."""
    machine = data.draw(machines(linear="XYZ"))
    target = 100.0 * np.asarray([data.draw(vectors) for _ in range(3)])
    tool = tuple(map(float, 100.0 * np.asarray(data.draw(vectors))))
    rotary = {n: np.array([90.0 * data.draw(numbers) for _ in range(3)]) for n, a in machine.axes.items() if a.rotary}
    nominal = Nominal(machine)
    try:
        commands = nominal.follow(target, tool, rotary, "round trip")
    except InputError as error:
        assert "miss" in error.problem  # three directions in one plane
        return
    reached = nominal.ball(commands, tool)
    scale = max(1.0, *(np.abs(v).max() for v in commands.values()))
    assert np.abs(reached - target).max() < 1e-9 * scale
    position = {n: v[1] * machine.axes[n].to_internal for n, v in commands.items()}
    assert ball(machine, position, tool) == pytest.approx(reached[1], abs=1e-9 * scale)


def test_a_target_that_cannot_be_reached_is_named_by_its_number():
    target = np.array([[10.0, 0.0, 5.0], [20.0, 0.1, 5.0], [30.0, 0.0, 5.0]])
    with pytest.raises(InputError, match=r"^line 3: the linear axes X, Z miss a pose by 0\.1 mm"):
        Nominal(preset("three-axis")).follow(target, (0.0, 0.0, 0.0), {"Y": 0.0}, lambda pose: f"line {pose + 2}")


@slow
@given(st.data())
def test_first_order_is_the_derivative(data):
    machine = data.draw(machines())
    position = data.draw(poses(machine))
    tool = ca.DM(100.0 * np.asarray(data.draw(vectors)))
    names = [f"E{c}0{n}" for n in machine.axis_names for c in ("XYZABC" if machine.axes[n].rotary else "ABC")]
    motions = [f"E{c}{n}" for n in machine.axis_names for c in "XYZABC"]
    errors = ca.SX.sym("e", len(names) + len(motions))
    location = {name: errors[i] for i, name in enumerate(names)}
    motion = {name: errors[len(names) + i] for i, name in enumerate(motions)}
    symbols = {name: ca.SX(value) for name, value in position.items()}
    exact = ball_in_workpiece(machine, symbols, tool, location=location, motion=motion)
    function = ca.Function("f", [errors], [exact, first_order(exact, errors)])
    direction = np.asarray(data.draw(st.lists(numbers, min_size=errors.numel(), max_size=errors.numel())))
    h = 1e-5
    (plus, line), (minus, _), (zero, same) = (function(k * h * direction) for k in (1, -1, 0))
    slope = (np.asarray(line) - np.asarray(same)) / h
    assert np.asarray(zero) == pytest.approx(np.asarray(same), abs=1e-12)
    assert slope == pytest.approx((np.asarray(plus) - np.asarray(minus)) / (2 * h), abs=1e-4)


@slow
@given(st.data())
def test_every_axis_is_a_rigid_motion(data):
    machine = data.draw(machines())
    name = data.draw(st.sampled_from(machine.axis_names))
    location = {f"E{c}0{name}": ca.SX(0.1 * data.draw(numbers)) for c in "XYZABC"}
    motion = {f"E{c}{name}": ca.SX(0.1 * data.draw(numbers)) for c in "XYZABC"}
    pose = axis_pose(machine.axes[name], "tool", ca.SX(data.draw(numbers)), location, motion)
    rotation = np.asarray(ca.evalf(pose.rotation))
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    point = ca.DM([1.0, 2.0, 3.0])
    back = pose.apply_inverse(pose.apply(point))
    assert np.asarray(ca.evalf(back)) == pytest.approx(np.asarray(point), abs=1e-12)


# ---- bases

MACHINE = Machine(
    name="bases",
    structure=Structure.parse("w C' B' b X t"),
    axes={
        "X": make_axis("X", travel=(-100.0, 300.0)),
        "B": make_axis("B", travel=(-30.0, 110.0)),
        "C": make_axis("C", travel=(-180.0, 180.0)),
    },
)


def term(**fields):
    return ErrorTerm(name="EAC", sigma=1.0, **fields)


def gram(term_, points=4001):
    """Mean products of the basis functions, with the constant first, over the box of travels."""
    grids = []
    for name in term_.over:
        axis = MACHINE.axes[name]
        low, high = (t * axis.to_internal for t in axis.travel)
        n = points if len(term_.over) == 1 else 301
        grids.append(low + (high - low) * (np.arange(n) + 0.5) / n)
    mesh = [m.ravel() for m in np.meshgrid(*grids, indexing="ij")]
    matrix = np.column_stack([np.ones(mesh[0].size), Basis(term_, MACHINE).matrix(*mesh)])
    return matrix.T @ matrix / len(matrix)


@pytest.mark.parametrize(
    "fields",
    [
        {"over": ("X",), "basis": ("polynomial",), "order": (6,)},
        {"over": ("B",), "basis": ("polynomial",), "order": (5,)},
        {"over": ("C",), "basis": ("fourier",), "order": (4,)},
        {"over": ("X",), "basis": ("fourier",), "order": (3,)},
        {"over": ("B", "C"), "basis": ("polynomial", "fourier"), "order": (2, 1)},
        {"over": ("X", "B", "C"), "basis": ("polynomial",) * 3, "order": (1, 1, 1)},
    ],
    ids=lambda f: "x".join(f["over"]) + "-" + f["basis"][0],
)
def test_bases_are_orthogonal_and_hold_no_constant(fields):
    products = gram(term(**fields), 4001) if len(fields["over"]) < 3 else gram_of_three(term(**fields))
    off = products - np.diag(np.diag(products))
    assert np.abs(off).max() < 2e-4
    assert np.diag(products)[1:].min() > 0.01


def gram_of_three(term_):
    """The same by Gauss's quadrature, exact for polynomials."""
    axes = [MACHINE.axes[n] for n in term_.over]
    nodes, weights = np.polynomial.legendre.leggauss(4)
    grids = [
        0.5 * (a.travel[0] + a.travel[1]) * a.to_internal + 0.5 * (a.travel[1] - a.travel[0]) * a.to_internal * nodes
        for a in axes
    ]
    mesh = [m.ravel() for m in np.meshgrid(*grids, indexing="ij")]
    weight = np.einsum("i,j,k->ijk", weights, weights, weights).ravel() / 8.0
    matrix = np.column_stack([np.ones(mesh[0].size), Basis(term_, MACHINE).matrix(*mesh)])
    return matrix.T @ (weight[:, None] * matrix)


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_splines_hold_no_constant_and_span_one_more_than_their_count(order):
    spline = term(over=("B",), basis=("bspline",), order=(order,))
    products = gram(spline)
    assert np.abs(products[0, 1:]).max() < 2e-4
    assert np.linalg.matrix_rank(products, tol=1e-8) == len(products)


def test_product_basis_keeps_pure_and_mixed_terms():
    names = Basis(term(over=("B", "C"), basis=("polynomial", "fourier"), order=(1, 1)), MACHINE).names
    assert names == ("cos1(C)", "sin1(C)", "P1(B)", "P1(B)*cos1(C)", "P1(B)*sin1(C)")


def test_straightness_leaves_its_slope_to_the_squareness():
    straightness = ErrorTerm(name="EYX", sigma=1.0, basis=("polynomial",), order=(3,))
    alone = Machine(name="m", structure=MACHINE.structure, axes=MACHINE.axes, errors={"EYX": straightness})
    square = ErrorTerm(name="EC0X", sigma=1.0)
    both = Machine(
        name="m", structure=MACHINE.structure, axes=MACHINE.axes, errors={"EYX": straightness, "EC0X": square}
    )
    assert basis_of(straightness, alone).names == ("P1", "P2", "P3")
    assert basis_of(straightness, both).names == ("P2", "P3")
