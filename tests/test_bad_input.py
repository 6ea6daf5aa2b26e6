"""Whatever lies where a machine or a campaign should lie, the answer is one sentence that names the file."""

import copy
import os
import tomllib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from symfive.campaign import Campaign, read_campaign, write_campaign
from symfive.errors import InputError
from symfive.machine import Machine, machine_from_data, read_machine, write_machine
from symfive.toml_files import toml_text

MACHINE = {
    "schema": "symfive.machine/1",
    "name": "m",
    "structure": "w C' B' X' b Y Z t",
    "axes": {
        "X": {"travel": [-100.0, 100.0], "max_feed": 9000.0, "max_acceleration": 3000.0},
        "Y": {"travel": [-100.0, 100.0], "kind": "linear", "direction": [0.0, 1.0, 0.0]},
        "Z": {},
        "B": {"origin": [0.0, 0.0, -50.0]},
        "C": {
            "travel": [-360.0, 360.0],
            "drive": {"position_gain": 40.0, "velocity_gain": 350.0, "integral_time": 0.05, "viscous": 5.0},
        },
    },
    "errors": {
        "EX0C": {"sigma": 50.0, "mean": 1.0},
        "EXC": {"basis": "fourier", "order": 2, "sigma": 5.0},
        "EAC": {"over": ["B", "C"], "basis": ["polynomial", "bspline"], "order": [2, 1], "sigma": 20.0, "knots": []},
        "EZB": {"basis": "bspline", "order": 3, "knots": [[-90.0, 0.0, 90.0]], "sigma": 3.0},
    },
    "workspace": {
        "table_radius": 150.0,
        "ball_height": [20.0, 200.0],
        "tool_length": [100.0, 200.0],
        "bar_lengths": [50.0, 100.0],
        "spindle_nose": {"radius": 40.0, "above_ball": 60.0},
    },
    "model": {"effects": [{"effect": "backlash", "axis": "C"}, "thermal_drift"]},
}
BALLS = {"table_ball": [0.0, 0.0, 50.0], "tool_ball": [0.0, 0.0, -120.0]}
CAMPAIGN = {
    "schema": "symfive.campaign/1",
    "machine": "machine.toml",
    "name": "c",
    "run": [
        {"id": "a", "file": "a.csv", "instrument": "ball_bar", "sampling": "static", **BALLS, "length": 100.0,
         "noise_um": 0.3, "setup_sigma_um": {"table_ball": 20.0, "tool_ball": 20.0, "length": 0.5}},
        {"id": "b", "file": "b.csv", "instrument": ["r_test", "encoder"], "encoder_axes": ["C"], "sampling": "dynamic",
         "start_s": 5.0, "noise_um": {"r_test": 0.4, "encoder": 0.1}},
        {"id": "c", "file": "c.csv", "instrument": "grid_encoder", "sampling": "static", **BALLS,
         "u": [1.0, 0.0, 0.0], "v": [0.0, 1.0, 0.0]},
        {"id": "d", "file": "d.csv", "instrument": "laser", "axis": "X", "sampling": "static"},
        {"id": "e", "file": "e.csv", "instrument": "displacement", "sampling": "static", "form_order": 2,
         "sensors": [{"direction": [1.0, 0.0, 0.0], "position": [50.0, 0.0, 0.0], "target": "rim", "gain_sigma": 0.1}]},
        {"id": "f", "file": "f.csv", "instrument": "drive_force", "axis": "C", "sampling": "dynamic", "v_rest": 0.1},
        {"id": "g", "file": "g.csv", "instrument": "tracker", "sampling": "static",
         "placement": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], "placement_sigma": [10.0, 1.0]},
    ],
}  # fmt: skip
ROWS = "t_s,X_mm,B_deg,C_deg,Y_mm,Z_mm\n0.0,0,0,0,0,0\n0.1,1,1,1,1,1\n"
JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-5, 5),
    st.sampled_from([10**400, -(10**400), 16**5000, 0, -1, 1e308, -1e308, 5e-324, float("nan"), float("inf")]),
    st.sampled_from(["", " ", "X", "C", "w", "\x00", "a\nb", "\u2028", "ä" * 300, "../x", "schema", "\x1b[31m"]),
    st.sampled_from([[], {}, [[]], [{}], [1, "a", []], {"a": {"b": [1]}}, [1.0] * 7, ["X", "X"], {"": 0}]),
    st.text(max_size=5),
    st.dates(),
)


def places(data, path=()):
    """Every key of nested mappings and lists."""
    entries = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in entries:
        yield (*path, key)
        yield from places(value, (*path, key))


def mutated(data, place, junk):
    data = copy.deepcopy(data)
    inner = data
    for key in place[:-1]:
        inner = inner[key]
    if junk is None:
        del inner[place[-1]]
    else:
        inner[place[-1]] = junk
    return data


def as_text(data):
    try:
        text = toml_text(data)
        tomllib.loads(text)
        return text
    except Exception:
        return None  # this junk is not TOML


def sentence(error, name):
    text = str(error)
    assert name in text and text == " ".join(text.split()) and text.endswith(".") and len(text) < 1500
    assert error.remedy and "Traceback" not in text and "not of the right form" not in text


@pytest.fixture(scope="module")
def campaign_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "machine.toml").write_text(toml_text(MACHINE))
    (folder / "campaign.toml").write_text(toml_text(CAMPAIGN))
    for run in CAMPAIGN["run"]:
        (folder / run["file"]).write_text(ROWS)
    return folder


def test_the_unchanged_ones_are_right(campaign_folder):
    assert isinstance(read_machine(campaign_folder / "machine.toml"), Machine)
    assert isinstance(read_campaign(campaign_folder), Campaign)


many = settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@many
@given(place=st.sampled_from(list(places(MACHINE))), junk=JUNK)
def test_any_wrong_value_in_a_machine(tmp_path, place, junk):
    data = mutated(MACHINE, place, junk)
    text = as_text(data)
    path = tmp_path / "machine.toml"
    try:
        if text is None:
            machine = machine_from_data(data, "model.json")
        else:
            path.write_text(text, encoding="utf-8")
            machine = read_machine(path)
    except InputError as error:
        sentence(error, "model.json" if text is None else "machine.toml")
        assert text is None or error.line is not None
        return
    if text is not None:  # it was legal: then nothing of it may be lost
        write_machine(machine, path)
        assert read_machine(path) == machine


@many
@given(place=st.sampled_from(list(places(CAMPAIGN))), junk=JUNK)
def test_any_wrong_value_in_a_campaign(campaign_folder, place, junk):
    text = as_text(mutated(CAMPAIGN, place, junk))
    if text is None:
        return
    path = campaign_folder / "mutated.toml"
    path.write_text(text, encoding="utf-8")
    try:
        read_campaign(path)
    except InputError as error:
        sentence(error, error.path.name)
        assert error.path.name != "mutated.toml" or error.line is not None


@many
@given(st.text(max_size=60), st.integers(0, 4000), st.integers(0, 50))
def test_text_in_the_middle_of_a_file(campaign_folder, tmp_path, text, at, cut):
    whole = (campaign_folder / "machine.toml").read_text()
    at %= len(whole)
    path = tmp_path / "machine.toml"
    path.write_bytes((whole[:at] + text + whole[at + cut :]).encode("utf-8", "surrogatepass"))
    try:
        read_machine(path)
    except InputError as error:
        sentence(error, "machine.toml")
        assert error.line is not None


@many
@given(st.binary(max_size=80), st.integers(0, 4000), st.booleans())
def test_bytes_in_a_csv(campaign_folder, data, at, instead):
    at %= len(ROWS)
    path = campaign_folder / "g.csv"
    path.write_bytes(data if instead else ROWS[:at].encode() + data + ROWS[at:].encode())
    try:
        read_campaign(campaign_folder)
    except InputError as error:
        sentence(error, "g.csv")
        assert error.line is not None
    finally:
        path.write_text(ROWS)


@pytest.mark.parametrize("size", [0, 1, 7, 40, 90, 150, 300])
def test_truncated_machine(campaign_folder, tmp_path, size):
    path = tmp_path / "machine.toml"
    path.write_bytes((campaign_folder / "machine.toml").read_bytes()[:size])
    with pytest.raises(InputError) as caught:
        read_machine(path)
    sentence(caught.value, "machine.toml")
    assert caught.value.line is not None


CONTENTS = {
    "empty": b"",
    "blank": b"\n\n \n",
    "binary": bytes(range(256)) * 20,
    "png": b"\x89PNG\r\n\x1a\n" + b"\0" * 100,
    "latin-1": "name = \"Fräse\"\n".encode("latin-1"),
    "utf-16": "t_s,X_mm\n".encode("utf-16"),
    "utf-16 without mark": "t_s,X_mm\n".encode("utf-16-le"),
    "utf-32": "t_s,X_mm\n".encode("utf-32"),
    "half a character": "t_s,X_mm\n1,ä".encode()[:-1],
    "html": b"<!DOCTYPE html><html></html>",
    "long line": b"x" * 3_000_000,
    "deep": b"a = " + b"[" * 50_000,
    "digits": b"a = " + b"9" * 100_000,
}  # fmt: skip


@pytest.mark.parametrize("name", CONTENTS)
def test_files_of_another_kind(campaign_folder, tmp_path, name):
    machine = tmp_path / "machine.toml"
    machine.write_bytes(CONTENTS[name])
    for read in (read_machine, read_campaign):
        with pytest.raises(InputError) as caught:
            read(machine)
        sentence(caught.value, "machine.toml")
        assert caught.value.line is not None
    csv = campaign_folder / "g.csv"
    csv.write_bytes(CONTENTS[name])
    with pytest.raises(InputError) as caught:
        read_campaign(campaign_folder)
    csv.write_text(ROWS)
    sentence(caught.value, "g.csv")
    assert caught.value.line is not None


def test_encodings_are_named(tmp_path):
    path = tmp_path / "m.toml"
    path.write_bytes(b'schema = "x"\nname = "Fr\xe4se"\n')
    with pytest.raises(InputError, match="UTF-8") as caught:
        read_machine(path)
    assert (caught.value.line, caught.value.column) == (2, 11)
    path.write_bytes('schema = "x"'.encode("utf-16"))
    with pytest.raises(InputError, match="UTF-16"):
        read_machine(path)


def sparse(path: Path, size: int) -> Path:
    with path.open("wb") as stream:
        stream.truncate(size)
    return path


@pytest.mark.parametrize("size", [30_000_000, 900_000_000, 50_000_000_000])
def test_huge_files_are_refused_at_once(campaign_folder, tmp_path, size):
    with pytest.raises(InputError) as caught:
        read_machine(sparse(tmp_path / "machine.toml", size))
    sentence(caught.value, "machine.toml")
    with pytest.raises(InputError) as caught:
        read_campaign(sparse(tmp_path / "campaign.toml", size).parent)
    sentence(caught.value, "campaign.toml")
    sparse(campaign_folder / "g.csv", size)
    with pytest.raises(InputError) as caught:
        read_campaign(campaign_folder)
    (campaign_folder / "g.csv").write_text(ROWS)
    sentence(caught.value, "g.csv")


def test_folders_devices_pipes_and_nothing(campaign_folder, tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "loop.toml").symlink_to(tmp_path / "loop.toml")
    (tmp_path / "folder.toml").mkdir()
    for name in ("pipe.toml", "loop.toml", "folder.toml", "nothing.toml", "n" * 300, "a\0b"):
        for read in (read_machine, read_campaign):
            with pytest.raises(InputError) as caught:
                read(tmp_path / name)
            assert caught.value.remedy and str(tmp_path) in str(caught.value)
    with pytest.raises(InputError, match="device"):
        read_machine("/dev/zero")
    (campaign_folder / "g.csv").unlink()
    (campaign_folder / "g.csv").mkdir()
    with pytest.raises(InputError, match="folder"):
        read_campaign(campaign_folder)
    (campaign_folder / "g.csv").rmdir()
    with pytest.raises(InputError, match="no such file"):
        read_campaign(campaign_folder)
    (campaign_folder / "g.csv").write_text(ROWS)


def test_no_rights(tmp_path, monkeypatch):
    path = tmp_path / "m.toml"
    path.write_text("x = 1")

    def refuse(*_args, **_kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(InputError, match="Permission denied"):
        read_machine(path)


def test_a_full_disk_leaves_the_old_machine(campaign_folder, tmp_path, monkeypatch):
    machine = read_machine(campaign_folder / "machine.toml")
    write_machine(machine, tmp_path / "m.toml")
    before = (tmp_path / "m.toml").read_text()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(InputError, match=r"m\.toml.*No space left"):
        write_machine(machine, tmp_path / "m.toml")
    assert (tmp_path / "m.toml").read_text() == before
    assert len(list(tmp_path.iterdir())) == 1


def test_writing_where_nobody_may(campaign_folder):
    with pytest.raises(InputError, match="cannot be"):
        write_campaign(read_campaign(campaign_folder), Path("/proc/nowhere/plan"))
