"""Machine skeletons from MTConnect probes: what the document tells is taken, what it does not is asked for, nothing else."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from symfive.cli import main
from symfive.errors import InputError
from symfive.importers import read_mtconnect
from symfive.machine import Machine, machine_to_data, read_machine, write_machine
from symfive.procedures import Nominal

DATA = Path(__file__).parent / "data" / "mtconnect"
TRUNNION, OLD = DATA / "trunnion.xml", DATA / "two-old-devices.xml"
HEAD = '<MTConnectDevices xmlns="urn:mtconnect.org:MTConnectDevices:{version}"><Devices><Device id="d" name="{name}">'
TAIL = "</Device></Devices></MTConnectDevices>"
SPINDLE = (
    '<DataItems><DataItem id="m" category="EVENT" type="ROTARY_MODE"><Constraints><Value>SPINDLE</Value></Constraints>'
    "</DataItem></DataItems>"
)


def axis(
    name: str, parent: str = "", axis: str = "", place: str = "", type: str = "", more: str = "", **extra: str
) -> str:
    """A component with a Motion (none where `type` is "-")."""
    tag = "Linear" if name[0] in "XYZ" else "Rotary"
    kind = type or ("PRISMATIC" if tag == "Linear" else "REVOLUTE")
    said = "".join(f' {key}="{value}"' for key, value in extra.items())
    parents = f' parentIdRef="m{parent}"' if parent else ""
    motion = (
        f'<Motion id="m{name}" type="{kind}" actuation="DIRECT" coordinateSystemIdRef="{extra.get("system", "m")}"{parents}>'
        f"{place}{f'<Axis>{axis}</Axis>' if axis else ''}</Motion>"
    )
    return f'<{tag} id="i{name}" name="{name}"{said}><Configuration>{"" if kind == "-" else motion}</Configuration>{more}</{tag}>'


def probe(folder: Path, *parts: str, version: str = "2.0", name: str = "five") -> Path:
    path = folder / "probe.xml"
    components = f"<Components><Axes id='a'><Components>{''.join(parts)}</Components></Axes></Components>"
    path.write_text(HEAD.format(version=version, name=name) + components + TAIL, encoding="utf-8")
    return path


def test_a_document_with_motion_tells_the_whole_machine():
    machine = read_mtconnect(TRUNNION)
    assert machine.structure.code == "w C' A' b X Y Z t" and machine.name == "Trunnion 5"
    assert machine.axes["A"].origin == (-10.0, 5.0, -620.0) and machine.axes["C"].origin == (0.0, 5.0, -575.0)
    assert machine.axes["A"].direction == (1.0, 0.0, 0.0) and machine.axes["C"].direction == (0.0, 0.0, 1.0)
    assert machine.axes["X"].travel == (-250.0, 250.0), "not the limits in work coordinates"
    assert machine.axes["Z"].travel == (-450.5, 0.0), "an old Constraint"
    assert machine.axes["X"].max_feed == 30_000.0 and machine.axes["X"].max_acceleration == 4000.0
    assert machine.axes["A"].max_feed == 10_800.0 and machine.axes["C"].max_feed == 36_000.0
    asked = [c for c in machine.comments if c.startswith(("fill in", "check"))]
    assert len(asked) == 2 and "travel of C" in asked[0] and "travel of Y" in asked[1] and "length is 400" in asked[1]


def test_what_the_document_lacks_is_not_in_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out = tmp_path / "new" / "machine.toml"
    words = ["import-mtconnect", OLD, "-o", out, "--device", "v-1", "--code", "w C' B' b X Y Z t"]
    assert main([str(w) for w in words]) == 0
    said = capsys.readouterr().err
    data = tomllib.loads(out.read_text(encoding="utf-8"))
    assert data["axes"] == {"B": {}, "C": {}, "X": {"travel": [0.0, 610.0]}, "Y": {}, "Z": {}}
    for what in ("travel of B", "travel of C", "travel of Y", "travel of Z", "origin of B", "origin of C"):
        assert f"# fill in {what} = " in out.read_text() and f"note: fill in {what}" in said
    assert "travel of X" not in said and "directions of B, C, X, Y, Z" in said and "w C' B' b X Y Z t" in said
    assert "as given, not from the document" in out.read_text() and "left out: S (a spindle)" in out.read_text()


@pytest.mark.parametrize("options", [{}, {"code": "w C2' A1' b X1 Y1 Z1 C1 t"}, {"code": "w A' b X Y Z C t"}])
def test_the_file_is_read_as_it_was_written(options: dict[str, str], tmp_path: Path):
    machine = read_mtconnect(TRUNNION, **options)
    write_machine(machine, tmp_path / "machine.toml")
    again = read_machine(tmp_path / "machine.toml")
    assert again == machine and machine_to_data(again) == machine_to_data(machine)
    assert again.comments == machine.comments and again.text == machine.text


def test_a_code_chooses_axes_by_any_of_their_names_and_is_compared():
    machine = read_mtconnect(TRUNNION, code="w C2' A1' b X1 Y1 Z1 C1 t")
    assert machine.axes["C2"].origin == (0.0, 5.0, -575.0) and machine.axes["C1"].rotary
    other = read_mtconnect(TRUNNION, code="w C' A' b Z Y X t")
    assert any("w C' A' b X Y Z t" in said for said in other.comments), "the code of the document"


@pytest.mark.parametrize("version", ["1.0", "1.7", "2.5"])
def test_namespaces_do_not_matter(version: str, tmp_path: Path):
    parts = (axis("X", axis="1 0 0"), axis("Z", "X", "0 0 1"), axis("S", "Z", more=SPINDLE))
    assert read_mtconnect(probe(tmp_path, *parts, version=version)).structure.code == "w b X Z t"


def test_a_spindle_on_the_bed_means_that_all_axes_carry_the_workpiece(tmp_path: Path):
    parts = (axis("S", more=SPINDLE), axis("X", axis="-1 0 0"), axis("C", "X", "0 0 1"))
    machine = read_mtconnect(probe(tmp_path, *parts))
    assert machine.structure.code == "w C' X' b t"
    assert machine.axes["X"].direction == (1.0, 0.0, 0.0) and machine.axes["C"].direction == (0.0, 0.0, -1.0)
    against = [c for c in machine.comments if "against ISO 841" in c]
    assert against == ["check direction of C: by the document it moves against ISO 841"]


def test_the_machine_moves_as_the_document_says(tmp_path: Path):
    """A nutating head: the tool after a turn of B, by the document's own transformations and by the machine."""
    tilt = "0 0.7071067811865476 0.7071067811865476"
    parts = (
        axis("Y", axis="0 -1 0"),
        axis("X", axis="1 0 0", place="<Origin>5 6 7</Origin>"),
        axis("B", "X", tilt, "<Transformation><Translation>10 20 30</Translation></Transformation>"),
        axis("S", "B", more=SPINDLE),
    )
    machine = read_mtconnect(probe(tmp_path, *parts))
    assert machine.structure.code == "w Y' b X B t" and machine.axes["B"].origin == (15.0, 26.0, 37.0)
    q, y, tool = 0.6, 3.0, np.array([1.0, 2.0, -90.0])
    e = np.array([float(v) for v in tilt.split()])
    arm = tool - machine.axes["B"].origin
    turned = arm * np.cos(q) + np.cross(e, arm) * np.sin(q) + e * (e @ arm) * (1.0 - np.cos(q))
    expected = machine.axes["B"].origin + turned + [4.0, 0.0, 0.0] - np.array([0.0, -1.0, 0.0]) * y
    commands = {"B": np.degrees([q]), "X": np.array([4.0]), "Y": np.array([y])}
    np.testing.assert_allclose(Nominal(machine).ball(commands, tool)[0], expected, atol=1e-9)


def test_coordinate_systems_are_placed_in_that_of_the_machine(tmp_path: Path):
    systems = (
        '<Configuration><CoordinateSystems><CoordinateSystem id="base" type="BASE"/>'
        '<CoordinateSystem id="m" type="MACHINE" parentIdRef="base"><Transformation><Translation>100 0 0</Translation>'
        '</Transformation></CoordinateSystem><CoordinateSystem id="side" type="OBJECT" parentIdRef="base"><Transformation>'
        "<TranslationDataSet><Entry key='X'>0</Entry><Entry key='Y'>10</Entry><Entry key='Z'>0</Entry></TranslationDataSet>"
        "<Rotation>0 0 90</Rotation></Transformation></CoordinateSystem></CoordinateSystems></Configuration>"
    )
    parts = (
        axis("X", axis="1 0 0"),
        axis("A", "X", "0 -1 0", "<Origin>1 2 3</Origin>", system="side"),
        axis("S", "A", more=SPINDLE),
    )
    path = probe(tmp_path, *parts)
    path.write_text(path.read_text().replace("<Components>", systems + "<Components>", 1))
    machine = read_mtconnect(path)
    np.testing.assert_allclose(machine.axes["A"].direction, (1.0, 0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(machine.axes["A"].origin, (-102.0, 11.0, 3.0), atol=1e-9)


def test_what_the_standard_leaves_open_is_asked_for(tmp_path: Path):
    """A turn about two axes has no order in the standard; one turn leaves open whether Axis is meant before or after."""
    for rotation, wanted in (("90 0 90", "fill in origin of B"), ("0 0 90", "check direction of B: its Motion turns")):
        place = f"<Transformation><Translation>1 2 3</Translation><Rotation>{rotation}</Rotation></Transformation>"
        parts = (axis("X", axis="1 0 0", place="<Origin>0 0 0</Origin>"), axis("B", "X", "0 1 0", place))
        machine = read_mtconnect(probe(tmp_path, *parts, axis("S", "B", more=SPINDLE)))
        assert any(c.startswith(wanted) for c in machine.comments), machine.comments


def test_units_that_are_not_known_are_said(tmp_path: Path):
    more = (
        '<DataItems><DataItem id="p" category="SAMPLE" type="POSITION" units="{units}"><Constraints><Maximum>2</Maximum>'
        "<Minimum>1</Minimum></Constraints></DataItem></DataItems>"
    )
    inch = read_mtconnect(probe(tmp_path, axis("X", more=more.format(units="INCH"))), code="w X' b t")
    assert inch.axes["X"].travel == (25.4, 50.8)
    odd = read_mtconnect(probe(tmp_path, axis("X", more=more.format(units="CUBIT"))), code="w X' b t")
    assert "travel" not in odd.text.split("[axes.X]")[1].split("#")[0] and "line 1 has it in 'CUBIT'" in odd.text


def test_names_of_users_stay_names(tmp_path: Path):
    name = "a &quot;b&quot; \\ # ]]&#10;structure = 1&#9;&lt;"
    machine = read_mtconnect(probe(tmp_path, axis("X"), name=name), code="w X' b t")
    write_machine(machine, tmp_path / "machine.toml")
    again: Machine = read_machine(tmp_path / "machine.toml")
    assert again.name == 'a "b" \\ # ]] structure = 1 <' and again.structure.code == "w X' b t"


BOMB = '<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>'
OUTSIDE = '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/hostname">]>'
XYZ = (axis("X"), axis("Y", "X"), axis("Z", "Y"))
BAD: dict[str, tuple[str | tuple[str, ...], dict[str, str], str]] = {
    "no XML": ("[axes]\nX = 1\n", {}, "line 1, column 1: not XML"),
    "cut off": (HEAD + "<Components>", {}, "not XML"),
    "empty": ("", {}, "not XML"),
    "bomb": (BOMB + "<x>&b;</x>", {}, "line 1: the document declares a type or entities"),
    "outer entity": (OUTSIDE + "<x>&a;</x>", {}, "declares a type or entities"),
    "deep": ("<a>" * 500, {}, "nested more than 100 deep"),
    "too large": ("<a>" + "x" * 5_000_001 + "</a>", {}, "more than 5000000"),
    "streams": ("<MTConnectStreams/>", {}, "'MTConnectStreams', not MTConnectDevices; save what the agent answers"),
    "no device": ("<MTConnectDevices><Devices/></MTConnectDevices>", {}, "has no Device"),
    "no axes": ((), {}, "no Linear or Rotary axis"),
    "no Motion": ((axis("X"), axis("Y", type="-")), {}, "X, Y is not in the document (Y without Motion); give it with --code"),
    "no spindle": (XYZ, {}, "give --code \"w b X Y Z t\" or --code \"w Z' Y' X' b t\""),
    "three chains": ((axis("X"), axis("Y"), axis("Z")), {}, "no one or two chains"),
    "branch": ((axis("X"), axis("Y", "X"), axis("Z", "X")), {}, "no one or two chains"),
    "circle": ((axis("X", "Y"), axis("Y", "X")), {}, "the parents of Motion 'mX' never end"),
    "no parent": ((axis("X", "Q"), axis("S", "X", more=SPINDLE)), {}, "parentIdRef 'mQ' names no Motion"),
    "not in code": (XYZ, {"code": "w b X Y A t"}, "no axis A of the code 'w b X Y A t'; it has X, Y, Z"),
    "twice": ((axis("X", nativeName="U"),), {"code": "w U' b X t"}, "are one component"),
    "no code": (XYZ, {"code": "X Y Z"}, "does not read from w over b to t"),
    "two numbers": ((axis("X", axis="1 0"),), {"code": "w X' b t"}, "line 1: Axis has 2 numbers, not 3"),
    "no number": ((axis("X", axis="1 0 inf"),), {"code": "w X' b t"}, "Axis holds 'inf', not a number"),
    "no direction": ((axis("J1", type="-"),), {"code": "w J1' b t"}, "direction of axis J1 is not in the document"),
    "no length": ((axis("X", axis="0 0 0"),), {"code": "w X' b t"}, "line 1: axis X: direction"),
    "no system": ((axis("X"), axis("Y", "X", "0 1 0", system="q")), {"code": "w b X Y t"}, "no coordinate system 'm'"),
    "no name": ((axis("X").replace('"X"', '"a b"').replace('"iX"', '"i_"'),), {}, "no name of its own"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_documents_end_in_one_sentence(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    content, options, expected = BAD[case]
    path = tmp_path / "probe.xml"
    if isinstance(content, str):
        path.write_text(content)
    else:
        probe(tmp_path, *content)
    out = tmp_path / "machine.toml"
    words = ["import-mtconnect", str(path), "-o", str(out)]
    assert main([*words, *(w for key, value in options.items() for w in (f"--{key}", value))]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "probe.xml" in said and expected in said, said
    assert sorted(tmp_path.iterdir()) == [path], "nothing is written"


@pytest.mark.parametrize("device", ["", "Mill"])
def test_one_of_several_devices_must_be_chosen(device: str):
    with pytest.raises(InputError, match="choose one with --device: VMC, Saw"):
        read_mtconnect(OLD, device=device)


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["import-mtconnect", str(TRUNNION), "-o", str(tmp_path)]) == 2
    assert "exists" in capsys.readouterr().err and not list(tmp_path.iterdir())
