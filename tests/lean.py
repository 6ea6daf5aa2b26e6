"""Machines with few errors, for which a plan is found in a fraction of the time, or without drives."""

from dataclasses import replace
from functools import cache

from symfive.machine import Machine, preset


@cache
def location_only(name: str) -> Machine:
    """A preset with its location errors alone, without error motions."""
    machine = preset(name)
    return replace(machine, errors={k: v for k, v in machine.errors.items() if v.is_location}, text="")


def varying(machine: Machine, *names: str) -> Machine:
    """The machine with these errors alone."""
    return replace(machine, errors={name: machine.errors[name] for name in names}, text="")


def without_drives(machine: Machine) -> Machine:
    """The machine with axes that follow their commands at once."""
    return replace(machine, axes={name: replace(axis, drive=None) for name, axis in machine.axes.items()})
