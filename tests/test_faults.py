"""Every verb, with a fault at every rename, replace, link, fsync, write and mkdir: killed, refused by the system, or Ctrl-C.

What stands there afterwards is what stood there before, or the new results: never a part, never a mixture.
"""

from __future__ import annotations

import os
import random
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import symfive.cli as cli
import symfive.convert
import symfive.fleet  # noqa: F401
from symfive.campaign import write_campaign
from symfive.diagnose import diagnose
from symfive.files import read_text
from symfive.history import Details, History
from symfive.identify import fitted_model, identify
from symfive.machine import preset
from symfive.model import write_model
from symfive.outputs import _place, output_folder  # kernels without an exchange of folders
from symfive.procedures import campaign_of, r_test_grid
from symfive.report import diagnosis_report, save_figures  # noqa: F401  (loaded, so that their long work can be replaced)
from symfive.runs import Run
from symfive.simulate import simulate

MACHINE = preset("oyama-2010")
PROBE = Path(__file__).parent / "data" / "mtconnect" / "trunnion.xml"
Tree = dict[str, bytes]


def tree(path: Path) -> Tree:
    """All files at or below a path by name; one that is no folder by the name of nothing."""
    if path.is_dir():
        return {str(p.relative_to(path)): p.read_bytes() for p in sorted(path.rglob("*")) if p.is_file()}
    return {"": path.read_bytes()} if path.exists() else {}


@dataclass
class Faults:
    """Counts the steps that touch the disk below `root`; `at` each one, something happens before and after it."""

    root: Path
    at: Callable[[int, str], None] = lambda number, when: None
    count: int = 0
    _before: dict[str, Any] = field(default_factory=dict)

    def _concerned(self, place: Any) -> bool:
        name = os.readlink(f"/proc/self/fd/{place}") if isinstance(place, int) else os.path.abspath(place)
        return name.startswith(f"{self.root}{os.sep}") and not name.endswith(".lock")

    def _step(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def step(place: Any, *more: Any, **options: Any) -> Any:
            if not self._concerned(place):
                return call(place, *more, **options)
            self.count += 1
            number = self.count
            self.at(number, "before")
            if call is self._before.get("write") and len(more[0]) > 1:  # a write may stop in the middle
                more = (more[0][: len(more[0]) // 2],)
            result = call(place, *more, **options)
            self.at(number, "after")
            return result

        return step

    @contextmanager
    def patched(self) -> Iterator[Faults]:
        """While the block lasts."""
        names = ("rename", "replace", "link", "fsync", "write", "mkdir")
        self._before = {name: getattr(os, name) for name in names}
        exchanged = _place.exchanged
        try:
            for name, call in self._before.items():
                setattr(os, name, self._step(call))
            _place.exchanged = self._step(exchanged)
            yield self
        finally:
            for name, call in self._before.items():
                setattr(os, name, call)
            _place.exchanged = exchanged


def recorded(run: Run) -> str:
    """What a head writes over a whole R-test run, five rows a second: at rest for 2 s at each pose, far off between two."""
    time = np.arange(run.time[0] - 5.0, run.time[-1] + 5.0, 0.2)
    pose = np.abs(time[:, None] - run.time).argmin(axis=1)
    still = np.stack(list(run.readings.values()), axis=1)[pose]
    moving = np.abs(time - run.time[pose]) > 1.01
    rows = still + (1e3 * moving * np.sin(7.0 * time))[:, None]
    return "".join(f"{t:.1f},{','.join(f'{x:.3f}' for x in row)}\n" for t, row in zip(time, rows, strict=True))


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    """What the verbs read, and their long computations done once."""
    root = tmp_path_factory.mktemp("world")
    plan = campaign_of(MACHINE, r_test_grid(MACHINE, step_deg=90.0))
    write_campaign(plan, root / "plan")
    measured, fits, drawn = {}, {}, {}
    for name, seed in (("a", 1), ("b", 2)):
        campaign = simulate(plan, seed=seed).campaign
        write_campaign(campaign, root / name)
        measured[name], fits[name] = campaign, identify(campaign)
        (root / f"model-{name}").mkdir()
        write_model(fitted_model(fits[name]), root / f"model-{name}" / "model.json")
        rows = "".join(f"{angle},{angle % 7 + seed}\n" for angle in range(0, 720, 4))
        (root / f"{name}.csv").write_text(f"angle,deviation\n{rows}")
        shutil.copy(PROBE, root / f"{name}.xml")
        for number, run in enumerate(campaign.runs, start=1):
            (root / f"{name}-{number}.txt").write_text(recorded(run))
        write_model(fitted_model(fits[name]), root / "results" / name / "model.json")
        with History(root / f"history-{name}", create=True) as history:
            history.add(root / "results" / name, Details(time=1.4e9))
    modules = sys.modules
    undo = pytest.MonkeyPatch()

    def read_and(answer: Callable[[str], Any]) -> Callable[..., Any]:
        return lambda campaign, **options: answer(campaign.path.name)

    @cache
    def found(name: str) -> Any:
        return diagnose(measured[name])

    search, plans = modules["symfive.design"].plan, dict[int, Any]()

    def planned(machine: Any, **options: Any) -> Any:
        if options["seed"] not in plans:
            plans[options["seed"]] = search(machine, **options)
        return plans[options["seed"]]

    undo.setattr(modules["symfive.design"], "plan", planned)
    style = modules["symfive.report._style"].rendered

    def rendered(figure: Any, format: str) -> bytes:
        return drawn.setdefault(format, style(figure, format)) if format not in drawn else drawn[format]

    undo.setattr(modules["symfive.identify"], "identify", read_and(fits.__getitem__))
    undo.setattr(modules["symfive.fleet"], "identify", read_and(fits.__getitem__))
    undo.setattr(modules["symfive.diagnose"], "diagnose", read_and(found))
    for module in ("_report", "_page"):
        undo.setattr(modules[f"symfive.report.{module}"], "rendered", rendered)
    undo.setattr(modules["symfive.convert"], "convert", lambda name, data: (read_text(root / f"{name}.csv"), plan)[1])
    yield root
    undo.undo()


POLAR = ["import-polar", "three-axis", "{}.csv", "--radius", "100", "--feed", "1000", "-q"]
VERBS = {
    "simulate": ["simulate", "plan", "--seed", "{n}", "-q"],
    "identify": ["identify", "{}", "--no-figures", "-q"],
    "identify with figures": ["identify", "{}", "-q"],
    "predict": ["predict", "model-{}", "{}", "-q"],
    "diagnose": ["diagnose", "{}", "-q"],
    "codegen": ["codegen", "model-{}", "-q"],
    "import-polar": POLAR,
    "convert": ["convert", "{}", "-q"],
    "fleet": ["fleet", "{}", "--no-figures", "--workers", "0", "-q"],
    "import-mtconnect": ["import-mtconnect", "{}.xml", "-q"],
    "import": ["import", *POLAR[1:3], "--map", "angle=1:deg", "--map", "deviation=2:um", *POLAR[3:]],
    "import-rests": ["import-rests", "plan", "{}-1.txt", "{}-2.txt", "-q"],
    "standards": ["standards", "{}", "-q"],
    "history show": ["history", "show", MACHINE.name, "--history", "history-{}"],
    "history fleet": ["history", "fleet", "--history", "history-{}"],
    "history certificate": ["history", "certificate", "results/{}", "-q"],
    "plan": ["plan", "oyama-2010", "--points", "4", "--starts", "1", "--seed", "{n}", "-q", "--nc", "iso", "--nc", "heidenhain"],
}  # fmt: skip
KINDS: dict[str, Callable[[], BaseException]] = {
    "error": lambda: OSError(5, "Input/output error"),
    "interrupt": KeyboardInterrupt,
}


FILES = {"import-mtconnect": "out.toml", "standards": "out.json", "history certificate": "out.xml"}
"""Verbs that write one file, which is never replaced."""
NEVER_REPLACED = ("fleet", *FILES)
"""Of a fleet each machine's folder is one result, as `identify` writes it."""


def words_of(verb: str, which: str, target: Path, *more: str) -> list[str]:
    filled = [word.format(which, n="ab".index(which)) for word in VERBS[verb]]
    return [*filled, "-o", str(target), *more]


def target_of(verb: str, folder: Path) -> Path:
    return folder / FILES.get(verb, "out")


def clean(path: Path) -> None:
    """What the next call does before it begins."""
    try:
        with output_folder(path, overwrite=True):
            raise InterruptedError
    except (InterruptedError, ValueError):
        pass


def state(verb: str, target: Path, campaign: str) -> Tree:
    """The one thing that the verb writes; of a fleet, where each machine is one, the machine's."""
    if verb != "fleet":
        clean(target)
        return tree(target)
    clean(target / campaign)
    return tree(target / campaign)


def points(verb: str, world: Path, folder: Path, capsys: pytest.CaptureFixture[str], every: int, old: bool) -> int:
    """Inject faults at every n-th step of one verb and compare; returns the number of faults."""
    replaces = old and verb not in NEVER_REPLACED
    more = ["--overwrite"] if replaces else []
    target = target_of(verb, folder)
    start, tried, random_ = folder / "start", 0, random.Random(1)
    start.mkdir(parents=True)
    if replaces:
        assert cli.main(words_of(verb, "a", target_of(verb, start))) == 0, capsys.readouterr().err
        (start / "out" / "notes.txt").write_text("mine")

    def begin() -> None:
        for left in (target, *folder.glob(".out*")):
            shutil.rmtree(left) if left.is_dir() else left.unlink(missing_ok=True)
        if replaces:
            shutil.copytree(target_of(verb, start), target)

    def run() -> int:
        return cli.main(words_of(verb, "b", target, *more))

    key = "b"
    begin()
    before = state(verb, target, key)
    shots: list[Path] = []

    def shoot(number: int, when: str) -> None:  # what a kill at this moment would leave
        if (number + (when == "after")) % every == 0:
            shots.append(folder.parent / f"{folder.name}-shots" / f"{len(shots)}")
            shutil.copytree(folder, shots[-1], ignore=shutil.ignore_patterns("start"), symlinks=True)

    with Faults(folder, shoot).patched() as whole:
        assert run() == 0, capsys.readouterr().err
    after = state(verb, target, key)
    assert after and after != before
    allowed = (before, after)
    for shot in shots:
        assert state(verb, target_of(verb, shot), key) in allowed, f"{verb} killed: {shot}"
        assert not list(shot.rglob(".out*")), shot
        tried += 1
    for kind, error in KINDS.items():
        for number in range(1 + random_.randrange(every), whole.count + 1, every):
            for moment in ("before",) if kind == "error" else ("before", "after"):
                begin()

                def fail(here: int, when: str, number=number, moment=moment, error=error) -> None:
                    if (here, when) == (number, moment):
                        raise error()

                with Faults(folder, fail).patched():
                    code = run()
                said = capsys.readouterr()
                assert "Traceback" not in said.err, (verb, kind, number)
                assert state(verb, target, key) in allowed, (verb, kind, number, moment)
                assert code in (0, 2, 130), (verb, kind, number, code)
                tried += 1
    return tried


QUICK = ("simulate", "identify", "fleet", "import-mtconnect")


@pytest.mark.parametrize("verb", QUICK)
def test_a_sample_of_faults_leaves_no_part(verb, world, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(world)
    assert points(verb, world, tmp_path / "f", capsys, every=13, old=True) > 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("verb", "old"),
    [(verb, old) for verb in VERBS for old in (False, True) if not (old and verb in NEVER_REPLACED)],
)
def test_no_fault_leaves_a_part(verb, old, world, tmp_path, monkeypatch, capsys, record_property):
    monkeypatch.chdir(world)
    # some compute or draw anew for each fault
    every = {"plan": 40, "diagnose": 40, "identify with figures": 12, "codegen": 8}.get(verb, 3)
    count = points(verb, world, tmp_path / "f", capsys, every=every, old=old)
    record_property("faults", count)
    with capsys.disabled():
        print(f" {verb}: {count} faults", end="")


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["simulate"])
def test_nor_where_names_cannot_be_exchanged(verb, world, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(world)
    monkeypatch.setattr(_place, "exchanged", lambda *_: False)
    assert points(verb, world, tmp_path / "f", capsys, every=7, old=True) > 8
