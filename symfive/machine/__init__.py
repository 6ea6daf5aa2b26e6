"""Machines as plain data: structural code, axes, drives, errors with priors, workspace."""

from symfive.machine._data import Axis, Drive, EffectEntry, ErrorTerm, Machine, Workspace, make_axis
from symfive.machine._read import machine_from_data, machine_to_data, read_machine, unknown_keys, write_machine
from symfive.machine._structure import Structure

__all__ = [
    "Axis", "Drive", "EffectEntry", "ErrorTerm", "Machine", "Structure", "Workspace",
    "machine_from_data", "machine_to_data", "make_axis", "read_machine", "unknown_keys", "write_machine",
]  # fmt: skip
