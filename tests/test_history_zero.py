"""One zero for all visits: the same readings of the independent plant, identified from two nominal machines."""

import numpy as np
import pytest
from plant.campaign import write_campaign
from plant.visits import Test as PlantTest

from symfive.history import Details, change_between, taken
from symfive.identify import identify
from symfive.results import write_identification

ERRORS = {
    "EX0C": 12.0,
    "EY0C": -8.0,
    "EA0C": 30.0,
    "EB0C": -20.0,
    "EX0B": 15.0,
    "EZ0B": 9.0,
    "EA0B": -25.0,
    "EC0B": 40.0,
}


@pytest.mark.parametrize(
    ("old", "new"), [
        ("origin = [0.0, 0.0, -50.0]", "origin = [0.02, 0.0, -50.015]"),
        ("origin = [0.0, 0.0, 0.0]", "origin = [-0.01, 0.03, 0.0]"),
        ("origin = [0.0, 0.0, -50.0]", "origin = [0.0, 0.0, -50.0]\ndirection = [2e-5, 1.0, -3e-5]"),
        ("origin = [0.0, 0.0, 0.0]", "origin = [0.0, 0.0, 0.0]\ndirection = [4e-5, -2e-5, 1.0]"),
    ], ids=["B moved", "C moved", "B tilted", "C tilted"],
)  # fmt: skip
def test_another_nominal_machine_is_no_change(tmp_path, old, new):
    test = PlantTest.of("table-bc")
    visits = []
    for name in ("first", "second"):
        folder = tmp_path / name
        write_campaign(folder, test.machine, test.runs, ERRORS, seed=1)
        if name == "second":
            text = (folder / "machine.toml").read_text()
            assert text.count(old) == 1
            (folder / "machine.toml").write_text(text.replace(old, new))
        out = tmp_path / f"results-{name}"
        out.mkdir()
        write_identification(identify(folder), out, figures=False)
        visits.append(taken(out, Details(time=1e9)))
    first, second = visits
    assert np.abs(second.values - first.values).max() > 9.0
    change = change_between(first, second)
    assert not change.changed and set(change.errors) == set(ERRORS)
    left = {
        name: abs(difference) / first.std[first.names.index(name)] for name, (difference, _, _) in change.errors.items()
    }
    assert max(left.values()) < 0.35, left
