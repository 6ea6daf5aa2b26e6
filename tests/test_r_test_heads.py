"""R-test heads in the spindle: readings in the machine's and the tool's frame against the independent plant."""

import re

import numpy as np
import plant
import pytest
from lean import location_only
from plant import LOCATION

from symfive.campaign import read_campaign
from symfive.cli import main
from symfive.errors import InputError
from symfive.identify import identify
from symfive.machine import write_machine
from symfive.model import Model

POSES = plant.grid_poses([-50.0, -20.0, 35.0], [0.0, 75.0, 160.0, 250.0])
SETUP = {"table_ball": [14.0, -9.0, 6.0], "tool_ball": [11.0, -7.0, 5.0], "length": 0.0, "zero": [120.0, -80.0, 40.0]}
SLANTED = [[2.0**0.5, 0.0, 1.0], [-(0.5**0.5), 1.5**0.5, 1.0], [-(0.5**0.5), -(1.5**0.5), 1.0]]
"""A nest's three sensors, square to each other and equally far from the upright: the same information as along the axes."""


def head_run(table, **more):
    return {**plant.r_test(table, "head-1", nest=[90.0, -25.0, 80.0], poses=POSES), **more}


@pytest.mark.parametrize("topology", ["table-bc", "head-cb", "mixed-c-b"])
@pytest.mark.parametrize(
    "options", [{"frame": "machine"}, {"frame": "tool"}, {"frame": "tool", "sense": "table-tool"}], ids=str
)
def test_readings_agree_with_the_plant(topology, options, tmp_path):
    table = plant.topology(topology, {n: {"sigma": 50.0} for n in LOCATION})
    run = head_run(table, **options)
    plant.write_campaign(tmp_path, table, [run], readings=False)
    read = plant.simulate_run(table, {**run, "setup_um": SETUP}, LOCATION, noise_options=plant.QUIET).values
    model = Model(read_campaign(tmp_path))
    values = dict(LOCATION) | {
        f"setup.head-1.table_ball.{c}": v for c, v in zip("xyz", SETUP["table_ball"], strict=True)
    }
    zero = np.array(SETUP["zero"])
    if options["frame"] == "tool":  # the tool ball is the zero there
        zero = zero + np.array(SETUP["tool_ball"]) * (-1.0 if "sense" in options else 1.0)
    else:
        values |= {f"setup.head-1.tool_ball.{c}": v for c, v in zip("xyz", SETUP["tool_ball"], strict=True)}
    values |= {f"setup.head-1.zero.{c}": float(v) for c, v in zip("xyz", zero, strict=True)}
    assert model.predict(values)["head-1"] == pytest.approx(read, abs=1e-6)


def test_slanted_sensors_read_their_share_and_identify(tmp_path):
    table = plant.static_table()
    truth = {n: 0.7 * v for n, v in LOCATION.items()}
    run = head_run(table, frame="tool", setup_sigma_um={"table_ball": 20.0, "tool_ball": 20.0})
    plant.write_campaign(tmp_path / "axes", table, [run], truth, seed=3)
    straight = read_campaign(tmp_path / "axes")
    axes = np.stack([straight.runs[0].readings[f"d{c}_um"] for c in "xyz"], axis=1)
    unit = np.array(SLANTED) / np.linalg.norm(SLANTED, axis=1, keepdims=True)
    seen = axes @ unit.T
    (tmp_path / "axes" / "campaign.toml").write_text(
        (tmp_path / "axes" / "campaign.toml").read_text() + f"directions = {SLANTED}\n"
    )
    file = tmp_path / "axes" / "head-1.csv"
    rows = [line.split(",") for line in file.read_text().splitlines()]
    head = [*rows[0][:-3], *(f"s{k}_um" for k in range(1, 4))]
    body = [[*row[:-3], *(f"{v:.6f}" for v in new)] for row, new in zip(rows[1:], seen, strict=True)]
    file.write_text("\n".join(",".join(row) for row in [head, *body]) + "\n")
    found = identify(read_campaign(tmp_path / "axes"))
    along = identify(straight)
    for name, value in truth.items():
        assert abs(found[name] - value) < 3.5 * found.uncertainty(name), name
        assert found[name] == pytest.approx(along[name], abs=0.02 * found.uncertainty(name)), name


def test_sensors_in_one_plane_are_refused(tmp_path):
    table = plant.static_table()
    plant.write_campaign(tmp_path, table, [head_run(table)], readings=False)
    text = (tmp_path / "campaign.toml").read_text()
    (tmp_path / "campaign.toml").write_text(text + "directions = [[1, 0, 0], [0, 1, 0], [1, 1, 0]]\n")
    with pytest.raises(InputError, match="do not span"):
        read_campaign(tmp_path)


@pytest.mark.slow
def test_a_head_in_the_spindle_is_no_nest(tmp_path, capsys):
    write_machine(location_only("oyama-2010"), tmp_path / "machine.toml")
    words = ["--frame", "tool", "--points", "6", "--setups", "1", "--starts", "1", "--no-proof", "-q"]
    assert main(["plan", str(tmp_path / "machine.toml"), "-o", str(tmp_path / "plan"), *words]) == 0
    pages = [*(tmp_path / "plan").glob("*.html"), *(tmp_path / "plan" / "nc").rglob("*.*")]
    said = capsys.readouterr().out + "".join(
        re.sub(r"(?s)<style.*?</style>|<[^>]*>", " ", path.read_text()) for path in pages
    )
    assert "R-test head" in said and "run head-1" in said and not re.search(r"\bnest\b", said, re.I)
