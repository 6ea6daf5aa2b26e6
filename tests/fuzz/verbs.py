"""Random calls of every verb on damaged files and with damaged words: `python -m tests.fuzz.verbs COUNT [--seed S]`.

A call is right that ends by itself within ten seconds of processor time with exit code 0, 1 or 2, without a traceback, with no
line of more than 800 characters on standard error, and that leaves every input as it was. All run in this process.
"""

import argparse
import contextlib
import io
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import FrameType

import click

import symfive.cli as cli
from symfive.campaign import write_campaign
from symfive.identify import fitted_model, identify
from symfive.machine import preset, write_machine
from symfive.model import write_model
from symfive.procedures import campaign_of, planar_circle, r_test_grid
from symfive.simulate import simulate

from .mutate import NUMBERS, STRINGS, Mutator

LIMIT_S = 10.0
MOST = 800
MACHINE = "Oyama, Ibaraki & Otsubo 2010, table BC on Y"
MAPPED = ["--map", "angle=1:deg", "--map", "deviation=2:um"]
VERBS = {
    "check": ["campaign"],
    "assess": ["campaign"],
    "simulate": ["campaign", "-o", "out", "--seed", "3"],
    "identify": ["campaign", "-o", "out", "--no-figures"],
    "predict": ["model.json", "campaign", "-o", "out"],
    "diagnose": ["campaign", "-o", "out"],
    "fleet": ["campaign", "-o", "out", "--no-figures", "--workers", "0"],
    "codegen": ["model.json", "-o", "out"],
    "plan": ["machine.toml", "-o", "out", "--points", "2", "--starts", "1", "--setups", "1"],
    "import-polar": ["three-axis", "polar.csv", "-o", "out", "--radius", "100", "--feed", "1000"],
    "import-rests": ["campaign", "polar.csv", "-o", "out"],
    "import-touches": ["campaign", "polar.csv", "-o", "out"],
    "import": ["three-axis", "polar.csv", "-o", "out", "--radius", "100", "--feed", "1000", *MAPPED],
    "standards": ["campaign", "--tolerance", "G=8", "--uncertainty", "G=1"],
    "import-mtconnect": ["probe.xml", "-o", "out.toml"],
    "convert": ["emps", "-o", "out", "--data", "data"],
    "history add": ["results", "--date", "2026-03-04", "--temperature", "21.5"],
    "history event": [MACHINE, "new spindle", "--kind", "repair", "--date", "2026-04-01"],
    "history show": [MACHINE, "-o", "out", "--tolerance", "EX0C=10", "--since", "2026-01-01"],
    "history fleet": ["-o", "out"],
    "history rebuild": ["results"],
    "history export": ["-o", "out.csv"],
    "history certificate": ["results", "-o", "out.xml", "--laboratory", "Lab", "--country", "DE"],
}
"""All verbs but `history serve`, which ends by Ctrl-C only."""
GROWS = {"history/index.sqlite", "results/visit.json"}
"""What `history` changes by right."""
WEIGHTS = {"diagnose": 1, "plan": 1}
"""Verbs that compute for seconds are called less often."""
WORDS = (
    "", " ", "-", "--", ".", "..", "/", "out", "campaign", "campaign/campaign.toml", "machine.toml", "model.json", "absent",
    "table-bc", "c,siemens", "EX0C", "X,Y,Z", "backlash:C", "0", "1", "-1", "2", "1e9", "1000000000", "nan", "inf", "-inf",
    "1e308", "1e-300", "0x10", "\x00", "é" * 300, "a" * 5000, "\n", "%s", "{0}", "__import__", "iso", "huber", "declared",
    "0,0,0",
    "1,nan,2",
)  # fmt: skip
LONG = {"--points", "--starts", "--scheduler", "--workers", "--count", "--repeats", "--returns", "--robust"}
"""Options whose right values only make a call long, or look for a server."""


class _TooLong(BaseException):
    pass


def _alarm(number: int, frame: FrameType | None) -> None:
    raise _TooLong


class Calls:
    """Makes calls in `folder`; `wrong` says of each that was not right what it was."""

    def __init__(self, folder: Path, rng: random.Random) -> None:
        self.folder, self.rng, self.wrong, self.longest = folder, rng, list[str](), 0.0
        self.codes = Counter[tuple[str, int]]()
        self._store = folder / "seeds"
        self._make()
        self._files = [path for path in sorted(self._store.rglob("*")) if path.is_file()]
        self._mutate = Mutator((), [path.read_bytes() for path in self._files])
        for verb, words in VERBS.items():  # first of all everything is imported, which is no part of a call
            if verb not in WEIGHTS:
                shutil.copytree(self._store, folder / "first" / verb)
                self._call([*verb.split(), *words], folder / "first" / verb, limit=60.0)
        self._parameters = {verb: _options_of(verb) for verb in VERBS}

    def _make(self) -> None:
        machine = preset("oyama-2010")
        machine = replace(machine, errors={name: machine.errors[name] for name in ("EX0C", "EA0B")})
        runs = [*r_test_grid(machine, step_deg=120.0, returning=False), *planar_circle(machine, rate_hz=2.0)]
        campaign = simulate(campaign_of(machine, runs), seed=1).campaign
        write_campaign(campaign, self._store / "campaign")
        write_machine(machine, self._store / "machine.toml")
        write_model(fitted_model(identify(campaign)), self._store / "model.json")
        (self._store / "polar.csv").write_text(
            "angle,deviation\n" + "".join(f"{a},{a % 3}\n" for a in range(0, 360, 4))
        )
        probe = Path(__file__).parent.parent / "data" / "mtconnect" / "trunnion.xml"
        shutil.copy(probe, self._store / "probe.xml")
        (self._store / "data" / "emps").mkdir(parents=True)
        (self._store / "data" / "emps" / "DATA_EMPS.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(400))
        self._call(["identify", "campaign", "-o", "results", "--no-figures"], self._store, limit=60.0)
        self._call(["history", "add", "results", "--date", "2026-01-04"], self._store, limit=60.0)

    def one(self) -> None:
        """One call."""
        rng, room = self.rng, self.folder / "room"
        shutil.rmtree(room, ignore_errors=True)
        shutil.copytree(self._store, room)
        verb = rng.choices(list(VERBS), [WEIGHTS.get(name, 8) for name in VERBS])[0]
        words = list(VERBS[verb])
        kind = rng.random()
        if kind < 0.6:
            place = rng.choice([path for path in self._files if self._concerns(path, verb, words)])
            damaged = room / place.relative_to(self._store)
            damaged.write_bytes(self._mutate(damaged.read_bytes(), rng.randrange(2**32)))
        if kind > 0.5:
            words = self._damaged(verb, words)
        before = {path: path.read_bytes() for path in room.rglob("*") if path.is_file()}
        self._call([*verb.split(), *words], room)
        for path, data in before.items():
            place = str(path.relative_to(room))
            if place not in GROWS and (not path.is_file() or path.read_bytes() != data):
                self._keep(room, [*verb.split(), *words], f"{place} is not as it was")
                break

    def _concerns(self, path: Path, verb: str, words: list[str]) -> bool:
        top = path.relative_to(self._store).parts[0]
        return top in [*words, *verb.split()] and path.name != "manifest.json"

    def _damaged(self, verb: str, words: list[str]) -> list[str]:
        rng = self.rng
        value = rng.choice([*WORDS, *(text.decode("utf-8", "replace") for text in (*NUMBERS, *STRINGS))])
        match rng.randrange(4):
            case 0:
                words[rng.randrange(len(words))] = value
            case 1:
                del words[rng.randrange(len(words))]
            case _:
                option = rng.choice([name for name in self._parameters[verb] if name not in LONG])
                words += [option, value] if rng.random() < 0.8 else [option]
        return words

    def _call(self, words: list[str], room: Path, limit: float = LIMIT_S) -> None:
        begin, before = time.process_time(), os.getcwd()
        out, err = io.StringIO(), io.StringIO()
        said = ""
        os.chdir(room)
        previous = signal.signal(signal.SIGPROF, _alarm)
        signal.setitimer(signal.ITIMER_PROF, limit, 1.0)  # again, where it was raised in a callback and lost
        code = -1
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                code = cli.main(words)
        except _TooLong:
            said = f"longer than {LIMIT_S:g} s, in {traceback.extract_tb(sys.exc_info()[2])[-2]}"
        except BaseException as error:
            said = f"{type(error).__name__}: {str(error)[:200]} at {traceback.extract_tb(error.__traceback__)[-1]}"
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, previous)
            os.chdir(before)
        if limit > LIMIT_S:
            return
        spent = time.process_time() - begin
        self.longest = max(self.longest, spent)
        if not said and spent > LIMIT_S:  # in compiled code no alarm is heard
            said = f"{spent:.0f} s"
        self.codes[words[0], code] += 1
        text = err.getvalue()
        if not said and code not in (0, 1, 2):
            said = f"exit code {code}"
        if not said and "Traceback" in text:
            said = f"a traceback: {text[-300:]}"
        if not said and code == 2 and text.startswith("symfive: ") and max(map(len, text.splitlines())) > MOST + 20:
            said = f"a line of {max(map(len, text.splitlines()))} characters"
        if said:
            self._keep(room, words, said)

    def _keep(self, room: Path, words: list[str], said: str) -> None:
        kept = self.folder / f"wrong-{len(self.wrong)}"
        shutil.copytree(room, kept, dirs_exist_ok=True)
        self.wrong.append(f"{[w[:80] for w in words]} in {kept}: {said}")


def _options_of(verb: str) -> list[str]:
    command: click.Command = cli.app
    for name in verb.split():
        assert isinstance(command, click.Group)
        command = command.commands[name]
    options = [parameter for parameter in command.params if isinstance(parameter, click.Option)]
    return sorted({name for option in options for name in (*option.opts, *option.secondary_opts)})


def main() -> int:
    """Make the calls; 1 where one was not right."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.verbs", description="Random calls of every verb.")
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", dest="folder", type=Path, default=None, help="where wrong calls are kept")
    options = parser.parse_args()
    folder = options.folder or Path(tempfile.mkdtemp(prefix="symfive-calls."))
    calls, begin, said = Calls(folder, random.Random(options.seed)), time.monotonic(), 0
    for number in range(1, options.count + 1):
        calls.one()
        for line in calls.wrong[said:]:
            print("WRONG", line, flush=True)
        said = len(calls.wrong)
        if number % 500 == 0:
            print(
                f"{number} calls, {said} wrong, longest {calls.longest:.1f} s, {time.monotonic() - begin:.0f} s",
                flush=True,
            )
    print(f"{options.count} calls: {said} wrong, longest {calls.longest:.1f} s; exit codes {dict(calls.codes)}")
    return int(bool(calls.wrong))


if __name__ == "__main__":
    sys.exit(main())
