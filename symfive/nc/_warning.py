"""What a program's head and the set-up sheet say: what was tested for collisions and what was not, and which point Z means."""

from __future__ import annotations

from collections.abc import Sequence

from symfive.campaign import Run
from symfive.instruments import instruments_of
from symfive.machine import Machine
from symfive.nc._arc import circle_of
from symfive.nc._post import Post

UNCHECKED = "Collisions were not checked"
CARE = "Run the program slowly, one hand on the feed override."
RECORDED = "Measure at feed override 100 percent: the feed is part of the result."
"""Instead, where the readings are those of a path at its feed."""
TESTED = (
    "Tested: spindle nose, tool, post, table and bar as simple bodies, at every pose and on every move after the stop before the "
    "first one."
)


def collision_warning(machine: Machine, post: Post, runs: Sequence[Run]) -> tuple[str, ...]:
    """Sentences for the head of a program of some runs and for the set-up sheet."""
    recorded = any(run.dynamic for run in runs)
    care = RECORDED if recorded else CARE
    if machine.workspace.spindle_nose is None:
        return f"{UNCHECKED}: the machine file names no spindle nose.", care
    if not post.tested:
        return f"{UNCHECKED} for the path of this program.", care
    return TESTED, f"Not tested: {', '.join(_untested(machine, runs))}.", *((RECORDED,) if recorded else ())


def _untested(machine: Machine, runs: Sequence[Run]) -> list[str]:
    """Bodies that the tests do not know, and moves whose beginning nobody knows."""
    below = [name for name in machine.structure.workpiece if machine.axes[name].rotary]
    above = [name for name in machine.structure.tool if machine.axes[name].rotary]
    cradle = [f"cradle and drives of {', '.join(below)}"] if below else []
    head = [f"the head of {', '.join(above)} above the spindle nose"] if above else []
    held = {instrument.in_spindle(run) for run in runs for instrument in instruments_of(run)}
    sensors = next((word for word in held if word.endswith("head")), "nest")
    return [
        *cradle,
        *head,
        "clamps",
        "cables",
        f"sensors of the {sensors}",
        "covers",
        "the first moves from the start position",
    ]


def which_point(machine: Machine, run: Run, post: Post) -> str:
    """Which point the words X, Y and Z of a program mean."""
    length = f"{-run.tool_ball[2]:g} mm"
    above = any(machine.axes[name].rotary for name in machine.structure.tool)
    nose = "the spindle nose" + (" with all rotary axes at 0" if above else "")
    if not post.centred or circle_of(machine, run) is not None:
        return f"X Y Z are of {nose}, without a tool length; the ball's centre is {length} below it"
    if not post.tool_centre_on:
        return (
            f"While tool-centre control is on X Y Z are of the ball's centre in the workpiece frame, its length {length} called "
            f"with it; elsewhere they are of {nose}, without a tool length"
        )
    on, off = (" ".join(text.split()) for text in (post.tool_centre_on, post.tool_centre_off))
    return (
        f"From {on} to {off} X Y Z are of the ball's centre in the workpiece frame, its length {length} called by these lines; "
        f"elsewhere they are of {nose}, without a tool length"
    )
