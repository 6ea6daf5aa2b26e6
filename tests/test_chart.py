"""Charts as SVG: where things are drawn, and which ticks stand at the axes."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from symfive.drawing import Panel, Scale, drawing, label, ordered_colours


@pytest.mark.parametrize(
    ("low", "high", "log", "expected"),
    [
        (0.0, 10.0, False, [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]),
        (-0.31, 0.29, False, [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2]),
        (1990.0, 2010.0, False, [1990.0, 1995.0, 2000.0, 2005.0, 2010.0]),
        (0.1, 100.0, True, [0.1, 1.0, 10.0, 100.0]),
        (1e-9, 1e9, True, [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9]),
    ],
)
def test_ticks_are_round_and_few(low: float, high: float, log: bool, expected: list[float]) -> None:
    assert Scale(low, high, 0.0, 100.0, log).ticks() == pytest.approx(expected)


def test_values_lie_between_the_ends_of_their_scale() -> None:
    assert Scale(2.0, 4.0, 10.0, 30.0)(np.array([2.0, 3.0, 4.0])) == pytest.approx([10.0, 20.0, 30.0])
    assert Scale(0.1, 10.0, 300.0, 100.0, log=True)(np.array([0.1, 1.0, 10.0])) == pytest.approx([300.0, 200.0, 100.0])


def test_axes_of_one_scale_hold_everything() -> None:
    panel = Panel.alike((10.0, 20.0, 300.0, 100.0), np.array([-5.0, 0.0]), np.array([5.0, 40.0]))
    assert np.diff(panel.x(np.array([0.0, 1.0]))) == pytest.approx(-np.diff(panel.y(np.array([0.0, 1.0]))))
    assert panel.y(np.array([0.0, 40.0])) == pytest.approx([120.0, 20.0]) and panel.x(0.0) == pytest.approx(160.0)


def test_a_drawing_is_well_formed_and_its_text_escaped() -> None:
    panel = Panel(Scale(0.0, 10.0, 50.0, 150.0), Scale(-1.0, 1.0, 100.0, 0.0))
    line = np.array([[[0.0, -1.0], [10.0, 1.0]]])
    parts = [
        panel.axes("x", "y", "a < b & c"), panel.lines(line, ["#123456"], 2.0, "3 1"), panel.dots(line[0], ["red", "blue"], 3.0),
        panel.bars(np.array([[0.0, 0.0]]), np.array([[5.0, 1.0]]), "#abcdef"), label("", 0.0, 0.0),
    ]  # fmt: skip
    root = ET.fromstring(drawing(200.0, 150.0, parts))
    texts = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    assert {"a < b & c", "x", "y", "−1", "10"} <= set(texts)
    paths = {e.get("stroke") or e.get("fill"): e.get("d") for e in root.iter("{http://www.w3.org/2000/svg}path")}
    assert paths["#123456"] == "M50.0 100.0L150.0 0.0" and paths["#abcdef"] == "M50.0 0.0h50.0v50.0h-50.0z"
    assert [(c.get("cx"), c.get("cy")) for c in root.iter("{http://www.w3.org/2000/svg}circle")] == [
        ("50.0", "100.0"),
        ("150.0", "0.0"),
    ]


def test_colours_go_from_dark_to_light() -> None:
    colours = [[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in ordered_colours(9)]
    assert np.all(np.diff(np.array(colours) @ [0.299, 0.587, 0.114]) > 0.0) and len(ordered_colours(1)) == 1
