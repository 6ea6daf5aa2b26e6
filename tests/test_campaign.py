"""Campaigns: read, written, joined without loss; every wrong row named by file, line, column and remedy."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from symfive.campaign import Campaign, Run, SetupSigma, read_campaign, write_campaign
from symfive.errors import InputError
from symfive.machine import preset
from symfive.procedures import Nominal, campaign_of, planar_circle, r_test_grid

SHARED = Path(__file__).parent / "data" / "campaigns"
FOLDERS = sorted(path.parent for path in SHARED.glob("*/*/campaign.toml"))

MACHINE = """schema = "symfive.machine/1"
structure = "w C' b X t"
[axes.X]
travel = [-100.0, 100.0]
[axes.C]
"""
CAMPAIGN = """# the first comment
schema = "symfive.campaign/1"
machine = "machine.toml"
operator = "me"            # unknown, kept

[[run]]
id = "one"
file = "sub/one.csv"       # in a folder
instrument = "ball_bar"
sampling = "static"
table_ball = [50.0, 0.0, 100.0]
tool_ball = [0.0, 0.0, -120.0]
length = 100.0
noise_um = 0.25
setup_sigma_um = { table_ball = 15.0, tool_ball = 10.0, length = 0.4, by = "hand" }
temperature = 20.5
[[run]]
id = "two"
instrument = ["r_test", "encoder"]
encoder_axes = ["X"]
sampling = "dynamic"
start_s = 100.0
noise_um = { r_test = 0.4, encoder = 0.1 }
"""
ONE = "t_s,C_deg,X_mm,dL_um\n0.0,0.0,1.5,-3.25\n6.0,10.0,2.5,1e-3\n"
TWO = "t_s,C_deg,X_mm,dx_um,dy_um,dz_um,X_act_mm\n0.0,0.0,1.5,1,2,3,1.5\n0.01,0.5,1.6,1,2,3,1.6\n"


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "c"
    (path / "sub").mkdir(parents=True)
    (path / "machine.toml").write_text(MACHINE)
    (path / "campaign.toml").write_text(CAMPAIGN)
    (path / "sub" / "one.csv").write_text(ONE)
    (path / "two.csv").write_text(TWO)
    return path


def assert_same(a: Campaign, b: Campaign) -> None:
    assert a.machine == b.machine
    assert a.extra == b.extra
    for x, y in zip(a.runs, b.runs, strict=True):
        plain = ["id", "file", "instrument", "sampling", "table_ball", "tool_ball", "length", "u", "v", "start_s"]
        for name in [*plain, "noise_um", "setup_sigma_um", "options"]:
            assert getattr(x, name) == getattr(y, name), name
        assert np.array_equal(x.time, y.time)
        for left, right in ((x.commands, y.commands), (x.readings, y.readings)):
            assert list(left) == list(right)
            assert all(np.array_equal(left[k], right[k]) for k in left)


def test_everything_is_read(folder):
    campaign = read_campaign(folder)
    one, two = campaign.runs
    assert one.options == {"temperature": 20.5} and one.setup_sigma_um.extra == {"by": "hand"}
    assert one.readings["dL_um"].tolist() == [-3.25, 1e-3]
    assert two.file == "two.csv" and two.noise("encoder") == 0.1 and two.dynamic
    assert campaign.comments == ("the first comment", "unknown, kept", "in a folder")
    said = " ".join(campaign.notes)
    assert '"operator"' in said and '"temperature"' in said and "run two declares no setup_sigma_um" in said
    assert campaign.measured and campaign.rows == 4


def test_a_run_without_its_noise_is_named(folder):
    (folder / "campaign.toml").write_text(CAMPAIGN.replace("noise_um = 0.25", ""))
    campaign = read_campaign(folder)
    (note,) = (note for note in campaign.notes if "noise_um" in note)
    assert note.startswith("run one ") and "0.3" in note
    assert campaign.runs[0].noise("ball_bar") == 0.3


def test_a_run_says_the_unit_of_its_noise_where_its_readings_have_one():
    plain = {
        "id": "r",
        "instrument": ("r_test", "ball_bar"),
        "sampling": "static",
        "time": [0.0],
        "commands": {"X": [0.0]},
    }
    run = Run(
        noise_um={"r_test": 0.4, "ball_bar": 0.2}, length=100.0, readings={"dx_um": [1.0], "dL_um": [2.0]}, **plain
    )
    assert "noise 0.4 and 0.2 µm, measured" in str(run)


def test_every_instrument_that_takes_its_set_up_as_usual_is_named(tmp_path):
    machine, plain = preset("three-axis"), {"sampling": "static", "time": [0.0], "commands": {n: [0.0] for n in "XYZ"}}
    sensors = {"sensors": [{"direction": [1.0, 0.0, 0.0], "position": [0.0, 0.0, 0.0]}]}
    runs = (
        Run(id="sensor", instrument=("displacement",), options=sensors, **plain),
        Run(id="line", instrument=("laser",), options={"axis": "X"}, **plain),
    )
    write_campaign(Campaign(machine=machine, runs=runs), tmp_path)
    file = tmp_path / "campaign.toml"
    file.write_text(re.sub(r"setup_sigma_um = .*\n", "", file.read_text(encoding="utf-8")), encoding="utf-8")
    (note,) = read_campaign(tmp_path).notes
    assert note.startswith("run sensor declares no setup_sigma_um")


def test_written_verbatim_and_the_same(folder, tmp_path, monkeypatch):
    campaign = read_campaign(folder)
    with monkeypatch.context() as nothing_to_edit:
        nothing_to_edit.setattr("tomlkit.parse", None)
        write_campaign(campaign, tmp_path / "again")
    assert (tmp_path / "again" / "campaign.toml").read_text() == CAMPAIGN
    assert (tmp_path / "again" / "machine.toml").read_text() == MACHINE
    assert_same(read_campaign(tmp_path / "again"), campaign)
    write_campaign(replace(campaign, text=""), tmp_path / "new")
    assert_same(read_campaign(tmp_path / "new"), campaign)
    assert read_campaign(tmp_path / "new").comments == campaign.comments


def test_changed_campaign_is_the_same_after_reading(folder, tmp_path):
    campaign = read_campaign(folder)
    one = replace(campaign.runs[0], noise_um=0.5, readings={})
    for runs in ((one, campaign.runs[1]), (one,)):
        changed = replace(campaign, runs=runs, name="night shift")
        write_campaign(changed, tmp_path / f"changed{len(runs)}")
        again = read_campaign(tmp_path / f"changed{len(runs)}")
        assert_same(again, changed)
        assert again.name == "night shift" and "the first comment" in again.comments
        assert not again.runs[0].measured


def test_numbers_are_written_exactly(tmp_path):
    rng = np.random.default_rng(3)
    values = np.concatenate([rng.normal(size=50) * 10.0 ** rng.integers(-12, 2, 50), [0.1 + 0.2, 1e-300, -0.0]])
    machine = preset("three-axis")
    commands = {name: np.clip(values, -40.0, 40.0) for name in machine.axis_names}
    run = Run(
        id="r", instrument=("r_test",), sampling="static", time=np.arange(53) / 3.0, commands=commands,
        readings={f"d{c}_um": values * k for k, c in enumerate("xyz", start=1)},
    )  # fmt: skip
    campaign = Campaign(machine=machine, runs=(run,))
    write_campaign(campaign, tmp_path / "c")
    assert_same(read_campaign(tmp_path / "c"), campaign)


@pytest.mark.parametrize("path", FOLDERS, ids=lambda p: f"{p.parent.name}-{p.name}")
def test_shared_campaigns_round_trip(path, tmp_path):
    campaign = read_campaign(path)
    assert campaign.measured and not campaign.notes
    write_campaign(campaign, tmp_path / path.name)
    assert (tmp_path / path.name / "campaign.toml").read_text() == (path / "campaign.toml").read_text()
    assert_same(read_campaign(tmp_path / path.name), campaign)


@pytest.mark.parametrize("path", FOLDERS, ids=lambda p: f"{p.parent.name}-{p.name}")
def test_shared_campaigns_stand_in_the_nest_or_on_the_bar(path):
    """Independent of our procedures: commands have 7 decimals, so 1e-5 mm of distance is all that may remain."""
    campaign = read_campaign(path)
    nominal = Nominal(campaign.machine)
    for run in campaign.runs:
        offset = nominal.ball(run.commands, run.tool_ball) - run.table_ball
        wanted = run.length or 0.0
        assert np.abs(np.linalg.norm(offset, axis=1) - wanted).max() < 1e-5


def test_joining_keeps_runs_apart():
    machine = preset("table-bc")
    campaign = campaign_of(machine, planar_circle(machine, radius=50.0))
    joined = campaign.joined(campaign, prefix="second-")
    assert [run.id for run in joined.runs] == ["xy-ccw", "xy-cw", "second-xy-ccw", "second-xy-cw"]
    ends = [run.start_s + run.duration for run in joined.runs]
    assert all(run.start_s >= end for run, end in zip(joined.runs[1:], ends, strict=False)), "one test at a time"
    assert campaign.joined(joined.select("second-xy-cw")).runs[-1].start_s == joined.runs[-1].start_s, (
        "a time that was stated"
    )
    with pytest.raises(InputError, match="xy-ccw"):
        campaign.joined(campaign)
    with pytest.raises(InputError, match="one machine"):
        campaign.joined(campaign_of(preset("head-bc"), r_test_grid(preset("head-bc"))))


BAD_ROWS = {
    "no column": ("dL_um", "", 1, None, "missing|no name"),
    "missing command": (ONE, "t_s,X_mm,dL_um\n0,1,2\n", 1, None, "C_deg"),
    "missing time": (ONE, "C_deg,X_mm,dL_um\n0,1,2\n", 1, None, "t_s"),
    "unknown column": ("dL_um", "dL_um,depth_um", 1, 5, "depth_um"),
    "axis the machine lacks": ("C_deg", "B_deg", 1, 2, "no axis B"),
    "unit suffix": ("X_mm", "X_um", 1, 3, "X_mm"),
    "unit suffix of a reading": ("dL_um", "dL_mm", 1, 4, "dL_um"),
    "twice": ("C_deg", "X_mm", 1, 3, "twice"),
    "text": ("2.5", "two", 3, 3, "'two'"),
    "decimal comma": ("2.5", "2,5", 3, None, "5 cells"),
    "empty cell": ("2.5", "", 3, 3, "is empty"),
    "nan": ("1e-3", "nan", 3, 4, "finite"),
    "inf": ("10.0", "-inf", 3, 2, "finite"),
    "overflow": ("10.0", "1e999", 3, 2, "finite"),
    "underscore": ("10.0", "1_0", 3, 2, "not a number"),
    "other digits": ("10.0", "١٠", 3, 2, "not a number"),
    "time stands": ("6.0", "0.0", 3, 1, "increase"),
    "time goes back": ("6.0", "-1.0", 3, 1, "increase"),
    "outside travel": ("2.5", "100.1", 3, 3, "travel"),
    "truncated row": ("10.0,2.5,1e-3\n", "10.0,2", 3, None, "3 cells"),
    "row too long": ("1e-3", "1e-3,4", 3, None, "5 cells"),
    "empty row": ("\n6.0", "\n\n6.0", 3, None, "empty"),
    "no rows": (ONE, "t_s,C_deg,X_mm,dL_um\n", 1, None, "no rows"),
    "empty": (ONE, "", 1, None, "empty"),
    "blank": (ONE, "\n \n\n", 1, None, "empty"),
    "no header": (ONE, "0.0,0.0,1.5,-3.25\n", 1, 1, "header"),
    "semicolons in rows": (
        ONE[ONE.index("\n") :],
        ONE[ONE.index("\n") :].replace(",", ";"),
        2,
        None,
        "by commas as the header",
    ),
    "commas in rows": (
        ONE[: ONE.index("\n")],
        ONE[: ONE.index("\n")].replace(",", ";"),
        2,
        None,
        "by semicolons as the header",
    ),
    "decimal commas between commas": (ONE, ONE.replace(".", ","), 2, None, "separate the columns by semicolons"),
    "comma and point in a number": (
        ONE,
        ONE.replace(",", ";").replace("10.0", "1.000,5"),
        3,
        2,
        "has a comma and a point",
    ),
    "both marks in one file": (
        ONE,
        ONE.replace(",", ";").replace("10.0", "10,0"),
        3,
        2,
        "decimal comma, line 2 a decimal point",
    ),
}


@pytest.mark.parametrize("name", BAD_ROWS)
def test_bad_rows(folder, name):
    old, new, line, column, said = BAD_ROWS[name]
    path = folder / "sub" / "one.csv"
    path.write_text(ONE.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError, match=said) as caught:
        read_campaign(folder)
    error = caught.value
    assert error.path == path and error.line == line and error.remedy
    assert column is None or error.column == column
    assert "one.csv" in str(error) and "\n" not in str(error)


@pytest.mark.parametrize("text", [ONE.replace("\n", "\r\n"), "\ufeff" + ONE, ONE.rstrip("\n"), ONE + "\n\n",
                                  ONE.replace("\n", "\r"), ONE.replace(",", " , ")])  # fmt: skip
def test_harmless_differences(folder, text):
    (folder / "sub" / "one.csv").write_bytes(text.encode("utf-8"))
    assert read_campaign(folder).runs[0].commands["X"].tolist() == [1.5, 2.5]


@pytest.mark.parametrize("sign", [";", "\t", " ; "])
@pytest.mark.parametrize("mark", [".", ","])
@pytest.mark.parametrize("block", [None, 64])
def test_semicolons_tabs_and_decimal_commas(folder, monkeypatch, sign, mark, block):
    expected = read_campaign(folder).runs[0]
    if block:
        monkeypatch.setattr("symfive.campaign._csv.BLOCK_BYTES", block)
    (folder / "sub" / "one.csv").write_text(ONE.replace(",", sign).replace(".", mark))
    run = read_campaign(folder).runs[0]
    for name, column in {**expected.commands, **expected.readings}.items():
        assert {**run.commands, **run.readings}[name].tolist() == column.tolist()


def test_time_column_may_stand_anywhere(folder):
    (folder / "sub" / "one.csv").write_text("X_mm,t_s,dL_um,C_deg\n1.5,0,1,0\n2.5,0,1,0\n")
    with pytest.raises(InputError, match="increase") as caught:
        read_campaign(folder)
    assert (caught.value.line, caught.value.column) == (3, 2)


def test_plan_has_no_readings_or_all(folder):
    (folder / "sub" / "one.csv").write_text("t_s,C_deg,X_mm\n0,0,1\n")
    assert not read_campaign(folder).runs[0].measured
    (folder / "two.csv").write_text(TWO.replace("dz_um,", "").replace("3,1.", "1."))
    with pytest.raises(InputError, match="dz_um"):
        read_campaign(folder)


def test_a_pause_in_a_recording_is_refused(folder):
    (folder / "two.csv").write_text(TWO + "0.02,0.5,1.6,1,2,3,1.6\n1e9,0.5,1.6,1,2,3,1.6\n")
    with pytest.raises(InputError, match="pauses") as caught:
        read_campaign(folder)
    assert caught.value.line == 5


BAD_RUNS = {
    'id = "one"': ['id = "../one"', 'id = ""', "id = 1", 'id = "two"'],
    'file = "sub/one.csv"': ['file = "../one.csv"', 'file = "/etc/passwd"', "file = 3", 'file = "two.csv"',
                             'file = "campaign.toml"', 'file = "C:\\\\one.csv"', 'file = "sub"', 'file = "no.csv"'],
    'instrument = "ball_bar"': ['instrument = "ruler"', "instrument = []", "instrument = 1", "", 'instrument = [["a"]]',
                                'instrument = ["ball_bar", "ball_bar"]'],
    'sampling = "static"': ['sampling = "slow"', "", "sampling = 1"],
    "table_ball = [50.0, 0.0, 100.0]": ["table_ball = [50.0, 0.0]", 'table_ball = "abc"', "table_ball = 5",
                                        "table_ball = [1, 2, true]", "table_ball = [nan, 0.0, 0.0]"],
    "length = 100.0": ["length = -1.0", "length = true", 'length = "long"', "", "length = inf"],
    "noise_um = 0.25": ["noise_um = 0.0", "noise_um = [1.0]", 'noise_um = "low"', "noise_um = { laser = 0.1 }",
                        "noise_um = {}x", "noise_um = {}"],
    "noise_um = { r_test = 0.4, encoder = 0.1 }": ["noise_um = { r_test = 0.4 }",
                                                  "noise_um = { r_test = 0.4, encoder = 0.1, laser = 0.1 }"],
    "start_s = 100.0": ['start_s = "now"', "start_s = [1]"],
    'encoder_axes = ["X"]': ['encoder_axes = ["Q"]', "encoder_axes = 5", "encoder_axes = [[1]]"],
    'setup_sigma_um = { table_ball = 15.0, tool_ball = 10.0, length = 0.4, by = "hand" }': [
        "setup_sigma_um = 5", "setup_sigma_um = { table_ball = -1.0 }", 'setup_sigma_um = { length = "x" }'],
    'schema = "symfive.campaign/1"': ['schema = "symfive.campaign/2"', ""],
    'machine = "machine.toml"': ['machine = "no.toml"', "machine = 7", 'machine = ""', 'machine = "sub"',
                                 'machine = "a\\u0000b"', 'machine = "campaign.toml"'],
}  # fmt: skip


@pytest.mark.parametrize(("old", "new"), [(o, n) for o, news in BAD_RUNS.items() for n in news])
def test_bad_runs(folder, old, new):
    assert old in CAMPAIGN
    (folder / "campaign.toml").write_text(CAMPAIGN.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_campaign(folder)
    error = caught.value
    assert error.path is not None and error.remedy and "\n" not in str(error)
    if error.path.name == "campaign.toml":
        assert error.line is not None


def test_no_run_and_no_file(folder):
    (folder / "campaign.toml").write_text(CAMPAIGN.split("[[run]]")[0])
    with pytest.raises(InputError, match="no runs"):
        read_campaign(folder)
    shutil.rmtree(folder)
    with pytest.raises(InputError, match="no such file"):
        read_campaign(folder)


def test_runs_validate_themselves():
    machine = preset("three-axis")
    run = planar_circle(machine, direction="cw")[0]
    for wrong in ({"u": (2.0, 0.0, 0.0)}, {"u": (0.0, 0.0)}, {"time": run.time[:3]}, {"time": []}, {"id": "a/b"}):
        with pytest.raises(InputError):
            replace(run, **wrong)
    with pytest.raises(InputError, match="differ in Z"):
        Campaign(machine=machine, runs=(replace(run, commands={k: run.commands[k] for k in "XY"}),))
    with pytest.raises(InputError):
        SetupSigma(plate=-1.0)
    with pytest.raises(ValueError, match="read-only"):
        run.time[0] = 1.0


def test_writing_is_whole_or_not_at_all(folder, tmp_path, monkeypatch):
    campaign = read_campaign(folder)

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.rename", fail)
    with pytest.raises(InputError, match="No space left"):
        write_campaign(campaign, tmp_path / "full")
    assert not (tmp_path / "full").exists()
    assert [p.name for p in tmp_path.iterdir()] == ["c"]


def test_output_over_a_file_is_refused(folder, tmp_path):
    (tmp_path / "taken").write_text("x")
    with pytest.raises(InputError, match="taken"):
        write_campaign(read_campaign(folder), tmp_path / "taken")
    with pytest.raises(InputError, match="cannot be written"):
        write_campaign(read_campaign(folder), tmp_path / "taken" / "below")


@pytest.mark.parametrize("stamp", [0.0, 1e-3, "jitter"])
def test_the_interval_of_a_run_is_right_however_its_stamps_are_rounded_and_where_rows_are_missing(stamp):
    """300 a second for 76 s, stamped to 1 ms or with 0.1 ms of jitter; five rows in a row were lost."""
    rate, rng = 300.0, np.random.default_rng(3)
    number = np.delete(np.arange(22_711), np.r_[4000, 9000:9005])
    time = number / rate
    if stamp == "jitter":
        time = np.sort(time + rng.uniform(-1e-4, 1e-4, len(time)))
    elif stamp:
        time = np.round(time / stamp) * stamp
    commands = {axis: np.zeros(len(time)) for axis in "XYZBC"}
    run = Run(id="r", instrument=("ball_bar",), sampling="dynamic", time=time, commands=commands, length=100.0)
    assert np.array_equal(run.steps, number)
    assert run.interval == pytest.approx(1.0 / rate, rel=1e-5)
    assert replace(run, time=time[:1], commands={a: v[:1] for a, v in commands.items()}).interval == 1.0


@pytest.mark.parametrize(
    ("right", "slip"),
    [("tool_ball =", "tool_bal ="), ("noise_um = 0.25", "noise_mu = 0.25"), ("start_s =", "strat_s ="),
     ("setup_sigma_um = {", "setup_sigma = {"), ("length = 0.4", "lenght = 0.4")],
)  # fmt: skip
def test_a_slip_in_a_key_is_refused_with_what_was_meant(folder, right, slip):
    """What nobody reads would be a ball 120 mm off, and a fit that says so with six digits."""
    text = (folder / "campaign.toml").read_text()
    (folder / "campaign.toml").write_text(text.replace(right, slip, 1))
    with pytest.raises(InputError, match=f"did you mean {right.split()[0]}") as caught:
        read_campaign(folder)
    assert caught.value.line == next(n for n, line in enumerate(text.splitlines(), 1) if right in line)
