"""What stands on a screen, and what the verbs can be given: things, paths, names."""

import re
from pathlib import Path

import pytest

import symfive as sf
from symfive.check import check
from symfive.design import Plan, plan_circles
from symfive.effects import make_effect
from symfive.identify import Identification, identify_by_position
from symfive.machine import preset, write_machine
from symfive.procedures import campaign_of, r_test_grid

LINES, WIDTH, HEAD = 60, 200, 200
"""A screen, and the longest `repr`."""
NESTS = Path(__file__).parent / "data" / "campaigns" / "static-none" / "fit"


@pytest.fixture(scope="module")
def plan() -> Plan:
    return sf.plan("table-bc", points=4, setups=1, starts=1, anywhere=False, prove=False)


@pytest.fixture(scope="module")
def fitted() -> Identification:
    return sf.identify(NESTS)


@pytest.fixture(scope="module")
def things(plan, fitted) -> dict[str, object]:
    machine = preset("table-bc")
    circles = plan_circles(
        machine, [make_effect("backlash", "C")], count=1, ratios=(0.9,), feeds=(500.0,), refine=False, certify=False
    )
    simulation = sf.simulate(plan)
    return {
        "machine": machine, "campaign": sf.read_campaign(NESTS), "run": plan.campaign.runs[0], "plan": plan,
        "assessment": plan.assessment, "circles": circles, "simulation": simulation, "identification": fitted,
        "fitted model": sf.fitted_model(fitted), "prediction": sf.predict(fitted, NESTS), "model": fitted.model,
        "check": check(NESTS),
    }  # fmt: skip


NAMES = ("machine", "campaign", "run", "plan", "assessment", "circles", "simulation", "identification", "fitted model",
         "prediction", "model", "check")  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_print_fits_a_screen_and_repr_a_line(things, name):
    thing = things[name]
    lines = str(thing).split("\n")
    assert len(lines) <= LINES and max(map(len, lines)) <= WIDTH, (len(lines), max(map(len, lines)))
    assert "\n" not in repr(thing) and len(repr(thing)) <= HEAD
    assert repr(thing).startswith(f"<{type(thing).__name__}") and "array(" not in str(thing)
    page = thing._repr_html_()
    assert page.startswith("<") and len(page) < 2 * (LINES * WIDTH)


def test_a_notebook_escapes_what_files_say():
    assert "<script>" not in sf.Campaign(
        machine=preset("table-bc"), runs=campaign_of(preset("table-bc"), r_test_grid(preset("table-bc"), step_deg=90.0)).runs,
        name="<script>",
    )._repr_html_()  # fmt: skip


def test_a_long_list_says_how_much_more_there_is(plan):
    from dataclasses import replace

    run = plan.campaign.runs[0]
    many = sf.Campaign(machine=plan.machine, runs=tuple(replace(run, id=f"r{i}", file=f"r{i}.csv") for i in range(100)))
    lines = str(many).split("\n")
    assert len(lines) < LINES and lines[-1] == "… and 70 more: campaign.runs"


def test_a_value_has_no_more_digits_than_its_uncertainty_leaves(fitted):
    assert re.search(r"[0-9]{5}", str(fitted)) is None and " ± " in str(fitted)


WRONG = [
    lambda: sf.identify(3), lambda: sf.diagnose(["measured"]), lambda: sf.assess(preset("table-bc")),
    lambda: sf.simulate(None), lambda: sf.predict(1.5, NESTS), lambda: sf.plan(7), lambda: sf.plan("table-xy"),
    lambda: sf.codegen(3, "nowhere"), lambda: sf.redundancies(object()), lambda: sf.identify("nowhere"),
    lambda: sf.diagnose(Path("nowhere.toml")), lambda: sf.identify_sequentially(2, ()), lambda: sf.predict("no.json", NESTS),
    lambda: sf.assess(NESTS / "machine.toml"), lambda: identify_by_position(0, "X"), lambda: plan_circles(1, []),
]  # fmt: skip


@pytest.mark.parametrize("call", range(len(WRONG)))
def test_a_verb_says_what_it_wants(call):
    with pytest.raises(sf.InputError) as caught:
        WRONG[call]()
    assert caught.value.remedy and len(str(caught.value)) < 400


def test_verbs_take_paths_and_names(tmp_path, plan, fitted):
    assert sf.assess(str(NESTS)).rank == sf.assess(sf.read_campaign(NESTS)).rank
    write_machine(preset("table-bc"), tmp_path / "m.toml")
    by_path = sf.plan(tmp_path / "m.toml", points=4, setups=1, starts=1, anywhere=False, prove=False)
    assert by_path.campaign.rows == plan.campaign.rows
    sf.write_model(sf.fitted_model(fitted), tmp_path / "model.json")
    by_path, by_thing = sf.predict(tmp_path, str(NESTS)), sf.predict(fitted, sf.read_campaign(NESTS))
    assert by_path.rms == pytest.approx(by_thing.rms)
    assert sf.simulate(plan, seed=1).campaign.rows == plan.campaign.rows
