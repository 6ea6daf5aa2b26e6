"""What a program's head says about collisions: what was tested, and what nobody has tested."""

from __future__ import annotations

from symfive.campaign import FIRST_LINE, Run
from symfive.machine import Machine
from symfive.nc._post import Post

__all__ = ["UNCHECKED", "collision_warning"]

UNCHECKED = "Collisions were not checked"
CARE = "Drive the program slowly, one hand on the feed."


def collision_warning(machine: Machine, run: Run, post: Post) -> tuple[str, ...]:
    """Sentences for the head of a run's program and for its set-up sheet."""
    if machine.workspace.spindle_nose is None:
        return f"{UNCHECKED}: the machine file names no spindle nose.", CARE
    if not post.tested:
        return f"{UNCHECKED} for the ways of this program.", CARE
    said = ["Tested: spindle nose, tool, post, table and bar as simple bodies, at every pose and between them.",
            "Not tested: clamps, cables, the nest's sensors, the way to the first pose. Run it in air first."]  # fmt: skip
    blocked = post.blocked.get(run.id, ())
    if blocked:
        lines = ", ".join(str(row + FIRST_LINE) for row in sorted(set(blocked)))
        said.append(f"NOT CLEAR on the way to line {lines} of {run.file or run.id}. {CARE}")
    return tuple(said)
