"""Machines as plain data: structural code, axes, drives, errors with priors, workspace."""

from symfive.machine._axis import Axis, Drive, make_axis
from symfive.machine._data import EffectEntry, Machine, Workspace, unknown_axis
from symfive.machine._errors import ErrorTerm
from symfive.machine._presets import designed_ball, preset, presets
from symfive.machine._read import (
    SCHEMA,
    machine_from_data,
    machine_problems,
    machine_to_data,
    read_machine,
    unknown_keys,
    write_machine,
)
from symfive.machine._structure import DEFAULT_DIRECTION, Structure, default_kind
from symfive.machine._suggest import error_names, refuse_slips

__all__ = [
    "DEFAULT_DIRECTION", "SCHEMA", "Axis", "Drive", "EffectEntry", "ErrorTerm", "Machine", "Structure", "Workspace",
    "default_kind", "designed_ball", "error_names", "machine_from_data", "machine_problems", "machine_to_data",
    "make_axis", "preset", "presets", "read_machine", "refuse_slips", "unknown_axis", "unknown_keys", "write_machine",
]  # fmt: skip
