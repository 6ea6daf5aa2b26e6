"""`codegen`: from a machine or a fitted model to files for controllers, whole or not at all."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

from symfive.codegen._subject import Subject, subject_of
from symfive.codegen.c import c_files
from symfive.codegen.isg import isg_files
from symfive.codegen.linuxcnc import linuxcnc_files
from symfive.codegen.setp import setp_files
from symfive.codegen.sheet import CONTROLS, sheet_files
from symfive.errors import InputError, among
from symfive.files import shown
from symfive.machine import Machine
from symfive.model import FittedModel
from symfive.outputs import output_folder, write_text

Target = Callable[[Subject, str], dict[str, str]]

TARGETS: dict[str, Target] = {
    "c": c_files,
    "linuxcnc": linuxcnc_files,
    "setp": setp_files,
    "isg": isg_files,
    **{control: partial(sheet_files, control=control) for control in CONTROLS},
}
"""What can be generated: each entry makes the files' names and texts from a subject and a prefix."""
_PREFIX = re.compile(r"[a-z][a-z0-9_]{0,23}\Z")


def codegen(
    source: Machine | FittedModel | Path | str,
    output: Path | str,
    *,
    target: str = "c",
    prefix: str = "sf",
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Generate the files of a target into the folder `output` and return their paths.

    `source`: a machine, a fitted model, the file of either, or the name of a preset. `target`: a name in `TARGETS`.
    `prefix` of every C name and file: lower-case letters, digits and `_`. The same source gives the same
    bytes. `overwrite` replaces earlier results.

    Raises `InputError` for an unknown target, an unusable prefix, and where the target cannot represent the machine.
    """
    among(target, TARGETS, f"there is no target {shown(target)}")
    if not _PREFIX.match(prefix):
        raise InputError(f"the prefix {shown(prefix)} cannot begin C names", remedy="use up to 24 of a-z, 0-9 and _")
    with output_folder(Path(output), overwrite=overwrite) as folder:
        texts = TARGETS[target](subject_of(source), prefix)
        for name, text in texts.items():
            write_text(folder / name, text)
    return tuple(Path(output) / name for name in texts)
