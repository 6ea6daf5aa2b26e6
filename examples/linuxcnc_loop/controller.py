"""LinuxCNC without a screen: kinematics built, control started, programmes run, joints recorded, everything stopped."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from symfive.codegen import codegen
from symfive.errors import InputError
from symfive.machine import Machine
from symfive.model import FittedModel
from symfive.outputs import output_folder, write_json

from .configuration import hal_text, ini_text, joint_letters

Array = NDArray[np.float64]
PREFIX = "sfloop"
"""The component is `sfloopkins`, so that no component of the user is written over."""
MODULES = Path("/usr/lib/linuxcnc/modules")
PROGRAMS = ("linuxcnc", "halcompile", "halsampler", "halcmd")
LOCK = Path("/tmp/linuxcnc.lock")
"""LinuxCNC's own lock file, at the place that its start script fixes."""
NOBODY = "65534"
"""LinuxCNC started by root drops to this user."""
PROGRAM_SECONDS = 900.0
STOP_SECONDS = 30.0


def say(text: str) -> None:
    """One line, at once."""
    print(text, flush=True)


def run_story(output: Path, story: Callable[[Path], Any], lines_of: Callable[[Any], list[str]]) -> int:
    """Runs a story into a folder and says its result; 0 done, 2 where the user has to do something first."""
    try:
        require_linuxcnc()
        with output_folder(output, overwrite=True) as folder:
            found = story(folder)
            write_json(folder / "result.json", found.to_data())
            say("\n".join(lines_of(found)))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


@dataclass(frozen=True)
class Recording:
    """What the servo thread recorded, one row a cycle: `line` of the programme (N,), `joints` letter → (N,) mm or degree."""

    line: NDArray[np.int64]
    joints: Mapping[str, Array]


def require_linuxcnc() -> None:
    """Raises `InputError` where LinuxCNC is missing, modules cannot be installed, or another one runs."""
    for program in PROGRAMS:
        if shutil.which(program) is None:
            raise InputError(
                f"LinuxCNC is not installed: there is no program {program}",
                remedy="install it (Debian: apt install linuxcnc-uspace linuxcnc-uspace-dev)",
            )
    if not os.access(MODULES, os.W_OK):
        raise InputError(
            f"halcompile --install cannot write to {MODULES}, the only place LinuxCNC loads modules from",
            remedy="run this as root",
        )
    if LOCK.exists():
        raise InputError(
            f"another LinuxCNC is running, or was killed ({LOCK} exists)", remedy="end it, or remove that file"
        )


def setp_lines(source: Machine | FittedModel) -> tuple[str, ...]:
    """The `setp` lines of a machine (every error 0) or of an identified model, as codegen writes them."""
    with tempfile.TemporaryDirectory() as folder:
        codegen(source, folder, target="linuxcnc", prefix=PREFIX)
        text = (Path(folder) / f"{PREFIX}kins.hal").read_text()
    return tuple(line for line in text.splitlines() if line.startswith("setp "))


class Controller:
    """A LinuxCNC configured for one machine, in `folder`; used inside `with Controller.of(machine)`. `version` is what the
    last session said."""

    def __init__(self, machine: Machine, folder: Path) -> None:
        self.machine = machine
        self.folder = folder
        self.letters = joint_letters(machine)
        self.version = ""

    @classmethod
    @contextmanager
    def of(cls, machine: Machine) -> Iterator[Controller]:
        """Kinematics component generated from the machine and installed; removed at the end. Raises `InputError`."""
        require_linuxcnc()
        folder = Path(tempfile.mkdtemp(prefix="linuxcnc-loop-"))
        before = signal.signal(signal.SIGTERM, _leave)
        try:
            folder.chmod(0o777)  # LinuxCNC started by root works as nobody
            controller = cls(machine, folder)
            controller._install()
            yield controller
        finally:
            (MODULES / f"{PREFIX}kins.so").unlink(missing_ok=True)
            shutil.rmtree(folder, ignore_errors=True)
            signal.signal(signal.SIGTERM, before)

    def _install(self) -> None:
        made = self.folder / "kinematics"
        codegen(self.machine, made, target="linuxcnc", prefix=PREFIX)
        done = subprocess.run(
            ["halcompile", "--install", f"{PREFIX}kins.comp"], cwd=made, capture_output=True, text=True, check=False
        )
        if done.returncode != 0:
            raise InputError(
                f"halcompile could not build the kinematics: {_last_lines(done.stdout + done.stderr)}",
                remedy="install the headers (Debian: linuxcnc-uspace-dev) and a C compiler",
            )

    def run(self, programs: Mapping[str, str], setp: Sequence[str], *, feed_override: float) -> dict[str, Recording]:
        """Starts the whole control with these values of the errors, runs the programmes and stops it; recordings by name."""
        folder = self.folder / "session"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        folder.chmod(0o777)
        self._write(folder, programs, setp, feed_override)
        self._start_to_stop(folder, PROGRAM_SECONDS * len(programs))
        done = folder / "session-done.json"
        log = (folder / "linuxcnc.log").read_text(errors="replace")
        if not done.exists():
            raise InputError(f"LinuxCNC ended early: {_last_lines(log)}", remedy="try its configuration by hand")
        status = json.loads(done.read_text())
        if status["error"]:
            raise InputError(
                f"LinuxCNC stopped a programme: {status['error']}", remedy="read the programme at that line"
            )
        self.version = str(status["version"])
        return {name: self._recording(folder / f"{name}.txt") for name in programs}

    def _write(self, folder: Path, programs: Mapping[str, str], setp: Sequence[str], feed_override: float) -> None:
        texts = {f"{name}.ngc": text for name, text in programs.items()}
        texts |= {
            "loop.ini": ini_text(self.machine, PREFIX),
            "loop.hal": hal_text(self.machine, PREFIX, setp),
            "tool.tbl": "",
            "session.json": json.dumps({
                "joints": len(self.letters), "feed_override": feed_override, "seconds": PROGRAM_SECONDS,
                "runs": [{"program": f"{name}.ngc", "samples": f"{name}.txt"} for name in programs],
            }),
        }  # fmt: skip
        for name, text in texts.items():
            (folder / name).write_text(text)
        shutil.copy(Path(__file__).with_name("driver.py"), folder / "driver.py")
        (folder / "driver.py").chmod(0o755)

    def _start_to_stop(self, folder: Path, seconds: float) -> None:
        environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "PYTHONPATH")}
        if os.geteuid() == 0:
            environment |= {"RTAPI_UID": NOBODY, "RTAPI_FIFO_PATH": str(folder / "fifo")}
        with (folder / "linuxcnc.log").open("w") as log:
            process = subprocess.Popen(
                ["linuxcnc", str(folder / "loop.ini")], cwd=folder, env=environment, stdin=subprocess.DEVNULL,
                stdout=log, stderr=subprocess.STDOUT, start_new_session=True,
            )  # fmt: skip
            try:
                process.wait(timeout=seconds)
            except subprocess.TimeoutExpired:
                raise InputError("LinuxCNC did not end in time", remedy="give the machine more speed") from None
            finally:
                _stop(process)

    def _recording(self, path: Path) -> Recording:
        # halsampler also says "overrun" when it begins while the count of samples is not at 0
        lines = [line for line in path.read_text().splitlines() if line != "overrun"]
        table = np.loadtxt(lines, ndmin=2)
        if not table.size or np.any(np.diff(table[:, 0]) != 1.0):
            raise InputError("the recorder lost samples", remedy="close other programs and repeat")
        return Recording(
            table[:, 1].astype(np.int64), {letter: table[:, 2 + i] for i, letter in enumerate(self.letters)}
        )


def _leave(number: int, frame: object) -> None:
    """SIGTERM like Ctrl-C: what was started is stopped on the way out."""
    raise SystemExit(128 + number)


def _stop(process: subprocess.Popen[bytes]) -> None:
    """Ends what is left of the control's process group: asked first, so that LinuxCNC's script cleans up behind itself."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with suppress(subprocess.TimeoutExpired):
            process.wait(timeout=STOP_SECONDS)


def _last_lines(text: str, count: int = 5) -> str:
    return " / ".join(line.strip() for line in text.splitlines()[-count:] if line.strip())
