"""Tool paths of parts: what NC words mean, where the tool cuts, what is refused and how."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.errors import InputError
from symfive.machine import preset
from symfive.toolpath import ToolPath, read_tool_path

MACHINE = preset("table-bc")
TOOL = 150.0


def _path(folder: Path, text: str, name: str = "part.ngc", **options: object) -> ToolPath:
    (folder / name).write_text(text, encoding="utf-8")
    return read_tool_path(folder / name, MACHINE, **options)  # type: ignore[arg-type]


def _ends(path: ToolPath, *names: str) -> list[list[float]]:
    return [[float(path.position[n][i]) for n in names] for i in (0, -1)]


def test_rapid_moves_do_not_count_and_words_stay_in_force(tmp_path: Path) -> None:
    path = _path(tmp_path, "N10 G0 X0 Y0 Z200 B0 C0\nG1 Z150 F500\nX10.\nG0 Z200\nX90\nG1 Z150\n")
    assert _ends(path, "X", "Z") == [[0.0, 200.0], [90.0, 150.0]]
    x, z = path.position["X"], path.position["Z"]
    assert not np.any((x > 10.0) & (x < 90.0))
    assert np.max(np.hypot(np.diff(x[x <= 10.0]), np.diff(z[x <= 10.0]))) <= 2.0 + 1e-9
    assert set(path.line.tolist()) == {2, 3, 6}
    assert not path.tip.any()


@pytest.mark.parametrize(
    "block",
    [
        "G2 X20 Y0 I10 J0",
        "G2 X20 Y0 R10",
        "G91 G2 X20 Y0 I10",
    ],
)
def test_half_circles_stay_on_their_circle(tmp_path: Path, block: str) -> None:
    """G2 from the left end of a diameter goes over the top."""
    path = _path(tmp_path, f"G0 X0 Y0 Z200\n{block}\n")
    x, y = path.position["X"], path.position["Y"]
    np.testing.assert_allclose(np.hypot(x - 10.0, y), 10.0, atol=1e-9)
    assert y.min() > -1e-9 and y.max() == pytest.approx(10.0, abs=0.05)


def test_whole_circles_helices_and_planes(tmp_path: Path) -> None:
    path = _path(tmp_path, "G0 X10 Y0 Z200\nG3 I-10 Z190\n")
    x, y, z = (path.position[n] for n in "XYZ")
    np.testing.assert_allclose(np.hypot(x, y), 10.0, atol=1e-9)
    assert y[len(y) // 4] > 9.0 and z[-1] == 190.0 and z[len(z) // 2] == pytest.approx(195.0, abs=0.5)
    over = _path(tmp_path, "G0 X10 Y0 Z200\nG18 G3 X-10 Z200 I-10 K0\n")
    assert over.position["Z"].min() == pytest.approx(190.0, abs=0.05)  # G3 in ZX turns Z to X: from +X through -Z
    assert over.position["Y"].max() == 0.0


def test_the_longer_arc_has_a_negative_radius(tmp_path: Path) -> None:
    short = _path(tmp_path, "G0 X10 Y0 Z200\nG3 X0 Y10 R10\n")
    long = _path(tmp_path, "G0 X10 Y0 Z200\nG3 X0 Y10 R-10\n")
    assert len(long) > 2.5 * len(short)
    np.testing.assert_allclose(np.hypot(long.position["X"] - 10.0, long.position["Y"] - 10.0), 10.0, atol=1e-9)


def test_inches_increments_and_degrees(tmp_path: Path) -> None:
    path = _path(tmp_path, "G20 G0 X1 Y0 Z8 B10\nG91 G1 X1. B5\nG90 X0\n")
    assert path.position["X"].max() == pytest.approx(50.8)
    assert path.position["B"][-1] == 15.0 and path.position["X"][-1] == 0.0


def test_what_z_means(tmp_path: Path) -> None:
    """Spindle nose; tip with G43; the tip's place in the workpiece with G43.4; shifted by the part's zero."""
    cut = "G0 X0 Y0 Z60\nG1 X5\n"
    assert _path(tmp_path, cut).position["Z"][0] == 60.0
    assert _path(tmp_path, f"G43 H1\n{cut}").position["Z"][0] == 60.0 + TOOL
    path = _path(tmp_path, f"G43.4 H1\n{cut}", zero=(1.0, 2.0, 3.0), tool_length=120.0)
    assert path.tip.all() and path.tool_length == 120.0
    assert _ends(path, "X", "Y", "Z") == [[1.0, 2.0, 63.0], [6.0, 2.0, 63.0]]
    assert _path(tmp_path, f"G43 H1\n{cut}", tool_centre=True).tip.all()


def test_length_and_zero_count_along_the_axes(tmp_path: Path) -> None:
    """Of a Z that counts downwards the nose is above the tip at a lower position."""
    machine = preset("three-axis")
    down = replace(machine.axes["Z"], direction=(0.0, 0.0, -1.0), travel=(-600.0, 0.0))
    machine = replace(machine, axes={**machine.axes, "Z": down}, text="")
    (tmp_path / "down.nc").write_text("G43 H1\nG0 X0 Y0 Z-60\nG1 X5\n")
    path = read_tool_path(tmp_path / "down.nc", machine, tool_length=120.0, zero=(1.0, 2.0, 30.0))
    assert [path.position[name][0] for name in "XYZ"] == [1.0, 2.0, -60.0 - 30.0 - 120.0]


def test_a_long_path_keeps_its_ends(tmp_path: Path) -> None:
    """40 m of short blocks come down to 20,000 places, evenly."""
    rows = [f"X{200.0 if i % 2 else -200.0}" for i in range(200)]
    path = _path(tmp_path, "G0 X-200 Y0 Z200\nG1 F900\n" + "\n".join(rows))
    assert 19_000 <= len(path) <= 20_002
    assert path.step == pytest.approx(199 * 400.0 / 2.0 / 20_000)


def test_a_table_of_poses(tmp_path: Path) -> None:
    path = _path(tmp_path, "C_deg,X_mm,Y_mm,Z_mm,B_deg\n1,2,3,4,5\n\n6,7,8,9,10\n", "part.csv")
    assert path.position["C"].tolist() == [1.0, 6.0] and path.position["B"].tolist() == [5.0, 10.0]
    assert path.line.tolist() == [2, 4]
    comma = _path(tmp_path, "t_s;X_mm;Y_mm;Z_mm;B_deg;C_deg\n0;1,5;2;3;4;5\n", "part.csv")
    assert comma.position["X"].tolist() == [1.5]


MOVE = "G0 X0 Y0 Z200\n"


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("", 1, "the file is empty"),
        ("G0 X0 Y0 Z0\nM30\n", None, "never cuts"),
        (f"{MOVE}G1 A10", 2, "no axis A"),
        (f"{MOVE}G1 Xnan", 2, "no word with a number"),
        (f"{MOVE}G1 X#1", 2, "parameter"),
        (f"{MOVE}G1 X[1+2]", 2, "parameter"),
        (f"{MOVE}o100 call", 2, "no word"),
        (f"{MOVE}TRAORI", 2, "no word"),
        (f"{MOVE}G68.2 X0 Y0 Z0 I0 J30 K0", 2, "tilted plane"),
        (f"{MOVE}G41 D1", 2, "cutter compensation"),
        (f"{MOVE}G81 X1 Z2 R3", 2, "G81 cannot be understood"),
        (f"{MOVE}M98 P1000", 2, "subprogram"),
        (f"{MOVE}G1 X1 Q5", 2, "Q5"),
        (f"{MOVE}G1 X1 X2", 2, "twice"),
        (f"{MOVE}G2 X10 Y0 R4", 2, "more than twice its radius"),
        (f"{MOVE}G2 X10 Y0 I4", 2, "mm from its centre"),
        (f"{MOVE}G2 X0 Y0 R4", 2, "ends where it begins"),
        ("G1 X1 Y1", 1, "before the place of Y is known"),
        ("X1 Y1", 1, "before G0, G1"),
        (f"{MOVE}G91 G28 Z0\nG90 G1 X5", 3, "before the place of Z is known"),
        (f"{MOVE}B30\nG43.4 H1 Z90\nG1 X5", 4, "before the place of Y is known"),
        (f"G54 {MOVE}G55\nG1 X5", 2, "G54 and G55"),
    ],
)
def test_what_is_not_understood_is_refused_with_its_line(
    tmp_path: Path, text: str, line: int | None, said: str
) -> None:
    with pytest.raises(InputError, match=said) as caught:
        _path(tmp_path, text)
    assert caught.value.path == tmp_path / "part.ngc" and caught.value.line == line
    assert str(caught.value).count("\n") == 0


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("", 1, "the file is empty"),
        ("X_mm,Y_mm,Z_mm,B_deg,C_deg\n", 1, "no poses"),
        ("X_mm,Y_mm,Z_mm,B_deg\n1,2,3,4\n", 1, '"C_deg" is missing'),
        ("X_mm,Y_mm,Z_mm,A_deg,C_deg\n1,2,3,4,5\n", 1, "no axis A"),
        ("X_um,Y_mm,Z_mm,B_deg,C_deg\n1,2,3,4,5\n", 1, "it must be X_mm"),
        ("X_mm,Y_mm,Z_mm,B_deg,C_deg\n1,2,3,4,nan\n", 2, "not a finite number"),
        ("X_mm,Y_mm,Z_mm,B_deg,C_deg\n1,2,3,4\n", 2, "4 cells, the header 5"),
    ],
)
def test_tables_are_refused_with_their_line(tmp_path: Path, text: str, line: int, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        _path(tmp_path, text, "part.csv")
    assert caught.value.path == tmp_path / "part.csv" and caught.value.line == line


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        read_tool_path(tmp_path / "part.ngc", MACHINE)


def test_a_table_has_no_zero(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="positions of the axes"):
        _path(tmp_path, "X_mm,Y_mm,Z_mm,B_deg,C_deg\n1,2,3,4,5\n", "part.csv", zero=(0.0, 0.0, 1.0))
