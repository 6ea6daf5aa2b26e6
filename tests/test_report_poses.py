"""Poses to be turned: the numbers of the page are those of the kinematics, users' words stay words, long runs stay light."""

import base64
import hashlib
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from markupsafe import Markup
from pages import HOSTILE, Page

from symfive.campaign import Campaign, Run, read_campaign
from symfive.drawing import SCRIPT, poses_figure
from symfive.drawing._poses import MOST_LINES, MOST_NAMES, MOST_POINTS, projected  # which rows are drawn
from symfive.identify import identify
from symfive.machine import preset
from symfive.procedures import Nominal, campaign_of, planar_circle, r_test_grid
from symfive.report import identification_report
from symfive.report._page import write_page  # a page with this picture alone
from symfive.simulate import simulate

CAMPAIGNS = Path(__file__).parent / "data" / "campaigns"
STATIC, DYNAMIC = (read_campaign(CAMPAIGNS / name / "fit") for name in ("static-ball-bar-two-heights", "dynamic-none"))


class Drawing(Page):
    """The shapes of a figure by run: kind → (points in space (N, 3), as drawn (N, 2))."""

    def __init__(self, text: str) -> None:
        self.runs: list[dict[str, tuple[np.ndarray, np.ndarray]]] = [{}]
        self.view: list[float] = []
        super().__init__(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        super().handle_starttag(tag, attrs)
        given = {key: value or "" for key, value in attrs}
        if "data-view" in given:
            self.view = [float(word) for word in given["data-view"].split()]
        if tag == "g":
            self.runs.append({})
        if "data-p" in given:
            space = np.array([float(word) for word in given["data-p"].split()]).reshape(-1, 3)
            drawn = given.get("d", f"{given.get('x')} {given.get('y')}").replace("h0", "")
            flat = np.array([float(word) for word in re.findall(r"-?[\d.]+", drawn)]).reshape(-1, 2)
            self.runs[-1][given.get("class", "text") + ("" if tag == "path" else str(len(self.runs[-1])))] = space, flat


def rows_of(run: Run, runs: int) -> np.ndarray:
    most = min(max(MOST_POINTS // runs, 2), run.rows)
    return np.unique(np.linspace(0, run.rows - 1, most).round().astype(int))


@pytest.mark.parametrize("campaign", [STATIC, DYNAMIC], ids=["static", "dynamic"])
def test_the_points_are_those_of_the_kinematics(campaign: Campaign):
    drawing = Drawing(poses_figure(campaign))
    nominal = Nominal(campaign.machine)
    assert len(drawing.runs) == 1 + len(campaign.runs)
    for run, shapes in zip(campaign.runs, drawing.runs[1:], strict=True):
        rows = rows_of(run, len(campaign.runs))
        balls = nominal.ball({name: values[rows] for name, values in run.commands.items()}, run.tool_ball)
        np.testing.assert_allclose(shapes["dots"][0], balls, atol=0.0501)
        np.testing.assert_allclose(shapes["nest"][0], [run.table_ball], atol=0.0501)
        bars = shapes["bars"][0].reshape(-1, 2, 3)
        assert len(bars) == (len(rows) if not run.dynamic else -(-len(rows) // -(-len(rows) // MOST_LINES)))
        np.testing.assert_allclose(np.linalg.norm(bars[:, 1] - bars[:, 0], axis=1), run.length, atol=0.2)


def test_the_tool_points_where_the_kinematics_say():
    machine = preset("oyama-2010")
    campaign = campaign_of(machine, r_test_grid(machine))
    run, shapes = campaign.runs[0], Drawing(poses_figure(campaign)).runs[1]
    ball, tip = shapes["tools"][0].reshape(-1, 2, 3).transpose(1, 0, 2)
    up = tip - ball
    rows = rows_of(run, len(campaign.runs))
    commands = {name: values[rows] for name, values in run.commands.items()}
    above = Nominal(machine).ball(commands, np.add(run.tool_ball, [0.0, 0.0, 1.0])) - Nominal(machine).ball(
        commands, run.tool_ball
    )
    np.testing.assert_allclose(up / np.linalg.norm(up, axis=1, keepdims=True), above, atol=0.01)
    assert "bars" not in shapes


def test_the_first_view_is_drawn_without_the_script():
    """From 60° to the left of X and 25° above the table, by rotations written another way."""
    drawing = Drawing(poses_figure(STATIC))
    *centre, scale, turn, tilt = drawing.view
    a, e = np.radians([-turn, tilt])
    about_z = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    about_y = np.array([[np.cos(e), 0.0, np.sin(e)], [0.0, 1.0, 0.0], [-np.sin(e), 0.0, np.cos(e)]])
    for shapes in drawing.runs:
        for space, flat in shapes.values():
            seen = (space - centre) @ (about_y @ about_z).T
            np.testing.assert_allclose(flat, scale * seen[:, 1:] * [1.0, -1.0], atol=0.0501)
            np.testing.assert_allclose(flat, projected(space, np.array(centre), scale), atol=0.0501)
            assert np.abs(flat[:, 0]).max() <= 360.0 and np.abs(flat[:, 1]).max() <= 240.0
    assert (turn, tilt) == (-60.0, 25.0)


def test_the_drawing_stays_inside_however_it_is_turned():
    *centre, scale = (drawing := Drawing(poses_figure(DYNAMIC))).view[:4]
    points = np.concatenate([space for shapes in drawing.runs for space, _ in shapes.values()])
    for turn in range(0, 360, 30):
        for tilt in range(-90, 91, 30):
            assert np.abs(projected(points, np.array(centre), scale, turn, tilt)).max() < 235.0


def test_frame_and_table_are_there():
    machine = preset("oyama-2010")
    drawing = Drawing(poses_figure(campaign_of(machine, r_test_grid(machine))))
    table, _ = drawing.runs[0]["grey"]
    np.testing.assert_allclose(np.linalg.norm(table, axis=1), machine.workspace.table_radius, atol=0.1)
    assert [word in drawing.words for word in ("x", "y", "z")] == [True] * 3 and drawing.tags.count("text") == 3


def _written(campaign: Campaign, folder: Path) -> str:
    write_page(folder / "page.html", "poses", Markup(poses_figure(campaign)))
    return (folder / "page.html").read_text(encoding="utf-8")


def test_what_users_wrote_is_escaped(tmp_path: Path):
    evil = replace(STATIC.runs[0])
    object.__setattr__(evil, "id", HOSTILE)  # the reader would refuse it
    campaign = replace(
        STATIC, machine=replace(STATIC.machine, name=f'" onload="{HOSTILE}'), runs=(evil, STATIC.runs[1])
    )
    drawing = Drawing(_written(campaign, tmp_path))
    assert drawing.tags.count("script") == 1 and drawing.words.count(HOSTILE) == 2
    assert not any(name.startswith("on") for name, _ in drawing.attributes)


def test_the_script_is_small_and_allowed_where_it_is_needed(tmp_path: Path):
    assert len(SCRIPT.encode()) < 4000 and "http" not in SCRIPT and "</" not in SCRIPT and "innerHTML" not in SCRIPT
    page = _written(STATIC, tmp_path)
    (script,) = re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert script.endswith(SCRIPT) and f"script-src 'sha256-{digest}'" in page
    write_page(tmp_path / "none.html", "none", "<p>no poses</p>")
    assert SCRIPT not in (tmp_path / "none.html").read_text(encoding="utf-8")


def many(counts: Sequence[int]) -> Campaign:
    run = DYNAMIC.runs[0]
    runs = []
    for i, count in enumerate(counts):
        rows = np.arange(count) % run.rows
        commands = {name: values[rows] for name, values in run.commands.items()}
        runs.append(
            replace(run, id=f"r{i}", file=f"r{i}.csv", time=0.01 * np.arange(count), commands=commands, readings={})
        )
    return replace(DYNAMIC, runs=tuple(runs))


@pytest.mark.parametrize("counts", [(24_000,), (3000,) * 8, (60,) * 400], ids=["one", "eight", "many"])
def test_24000_rows_stay_light(counts: tuple[int, ...]):
    text = poses_figure(many(counts))
    assert len(text.encode()) < 400_000
    drawing = Drawing(text)
    assert sum(len(shapes["dots"][0]) for shapes in drawing.runs[1:]) <= MOST_POINTS
    assert f"of {sum(counts)} rows are drawn" in drawing.words
    assert drawing.tags.count("button") == min(len(counts), MOST_NAMES)
    assert ("and 376 more" in drawing.words) == (len(counts) == 400)


@pytest.mark.slow
def test_a_whole_page_of_24000_rows_stays_below_3_mb(tmp_path: Path):
    machine = preset("table-bc")
    circles = [planar_circle(machine, feed=600.0, rate_hz=24.0, centre=(5.0 * i, 0.0, 100.0)) for i in range(4)]
    runs = [
        replace(run, id=f"{run.id}-{i}", file=f"{run.id}-{i}.csv") for i, pair in enumerate(circles) for run in pair
    ]
    campaign = simulate(campaign_of(machine, runs), seed=1).campaign
    assert 24_000 <= campaign.rows < 26_000
    page = identification_report(identify(campaign), tmp_path)
    assert '<figure class="poses">' in page.read_text(encoding="utf-8") and page.stat().st_size < 3_000_000


def test_without_a_ball_nothing_is_drawn():
    runs = tuple(replace(run, instrument=("encoder",)) for run in STATIC.runs)
    assert poses_figure(replace(STATIC, runs=runs)) == ""
