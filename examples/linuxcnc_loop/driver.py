#!/usr/bin/python3
"""The operator at the control: LinuxCNC's DISPLAY program, run by LinuxCNC's own Python.

Reads `session.json` from its folder, switches the machine on, homes it, runs one programme after the other while
`halsampler` records, starts again after every M0, and writes `session-done.json`. When it ends, LinuxCNC shuts down.
"""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import linuxcnc  # type: ignore[import-not-found]  # comes with LinuxCNC

POLL_S = 0.01
WATCH_S = 0.1
SWITCH_ON_S = 20.0
STALLED = "milltask, the interpreter's process, died"
"""Seen with LinuxCNC 2.9 on loaded computers, cause not found; the joints then stand still for ever."""


class Operator:
    """Commands, state and error messages of the control. Raises `RuntimeError` with the control's own words."""

    def __init__(self, joints: int) -> None:
        self.joints = joints
        self.command, self.state, self.errors = linuxcnc.command(), linuxcnc.stat(), linuxcnc.error_channel()

    def wait(self, done: Callable[[Any], bool], seconds: float, what: str) -> None:
        """Until the state says so."""
        end = time.monotonic() + seconds
        while True:
            self.state.poll()
            self.check()
            if done(self.state):
                return
            if time.monotonic() > end:
                raise RuntimeError(f"{what} took more than {seconds:.0f} s")
            time.sleep(POLL_S)

    def check(self) -> None:
        """Messages of the control that are errors."""
        message = self.errors.poll()
        if message and message[0] in (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR):
            raise RuntimeError(str(message[1]))

    def switch_on(self, feed_override: float) -> None:
        """Out of emergency stop, on, homed where it stands, feed override set."""
        self.command.state(linuxcnc.STATE_ESTOP_RESET)
        self.wait(lambda s: s.task_state != linuxcnc.STATE_ESTOP, SWITCH_ON_S, "leaving the emergency stop")
        self.command.state(linuxcnc.STATE_ON)
        self.wait(lambda s: s.task_state == linuxcnc.STATE_ON, SWITCH_ON_S, "switching the machine on")
        self.command.mode(linuxcnc.MODE_MANUAL)
        self.command.wait_complete()
        self.command.home(-1)
        self.wait(lambda s: all(s.homed[: self.joints]), SWITCH_ON_S, "homing")
        self.command.mode(linuxcnc.MODE_AUTO)
        self.command.wait_complete()
        self.command.feedrate(feed_override)
        self.command.wait_complete()

    def run(self, program: Path, samples: Path, seconds: float) -> None:
        """One programme from its first line to its end; the joints go into `samples`."""
        self.command.program_open(str(program))
        self.command.wait_complete()
        with samples.open("w") as stream:
            recorder = subprocess.Popen(["halsampler", "-t"], stdout=stream)
            try:
                sampling(True)
                self.command.auto(linuxcnc.AUTO_RUN, 0)
                self.wait(lambda s: s.interp_state != linuxcnc.INTERP_IDLE, SWITCH_ON_S, f"starting {program.name}")
                end = time.monotonic() + seconds
                while self.state.interp_state != linuxcnc.INTERP_IDLE:
                    if self.state.interp_state == linuxcnc.INTERP_PAUSED:
                        self.command.auto(linuxcnc.AUTO_RESUME)
                        self.wait(lambda s: s.interp_state != linuxcnc.INTERP_PAUSED, SWITCH_ON_S, "going on after M0")
                    self.wait(lambda s: True, POLL_S, "")
                    if subprocess.run(["pidof", "-q", "milltask"], check=False).returncode != 0:
                        raise RuntimeError(f"{STALLED} in {program.name}")
                    if time.monotonic() > end:
                        raise RuntimeError(f"{program.name} took more than {seconds:.0f} s")
                    time.sleep(WATCH_S)
                self.check()
                sampling(False)
                time.sleep(0.3)  # what is still in the sampler's queue
            finally:
                recorder.terminate()
                recorder.wait()


def sampling(on: bool) -> None:
    """Starts or stops the recording in the servo thread."""
    subprocess.run(["halcmd", "setp", "sampler.0.enable", str(int(on))], check=True)


def main() -> None:
    here = Path.cwd()
    session = json.loads((here / "session.json").read_text())
    status: dict[str, object] = {"error": "", "version": linuxcnc.version}
    try:
        operator = Operator(session["joints"])
        operator.switch_on(session["feed_override"])
        for run in session["runs"]:
            operator.run(here / run["program"], here / run["samples"], session["seconds"])
    except Exception as error:  # whatever it is, the one who waits for the file must be informed
        status["error"] = f"{type(error).__name__}: {error}"
    (here / "session-done.json").write_text(json.dumps(status))


if __name__ == "__main__":
    main()
