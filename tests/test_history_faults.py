"""The index killed at every write, and a disk that is full from any write on: nothing lost, nothing doubled."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from history_world import results

SHIM = Path(__file__).parent / "data" / "fault_shim.c"
COMPILER = shutil.which("cc") or shutil.which("gcc")
DRIVER = '''
"""Runs in a process with the shim preloaded: forks one child a fault, and looks at what each left."""
import ctypes, json, os, shutil, sys
from pathlib import Path
from symfive.history import Details, History, read_record
from symfive.errors import InputError
import symfive.model

root, verb, every = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
shim = ctypes.CDLL(None)
start, place = root / "start", root / "place"
more = [place / "r3", place / "r4"]

def act():
    with History(place / "history", create=True) as history:
        if verb == "add":
            history.add(more, Details(operator="Eve"), progress=lambda said: None)
        elif verb == "event":
            history.event("plant", "new spindle", kind="repair", when=1e9)
        else:
            history.rebuild([place])

def begin():
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(start, place)

def records():
    """Folders whose record is on the disk, and the events."""
    events = (place / "history" / "events").glob("*.json")
    return sorted(str(p.parent) for p in place.rglob("visit.json")), sorted(map(str, events))

def seen(history):
    folders = [str(f) for m in history.machines() for f in history.folders(m)]
    return sorted(folders), sum(len(history.events(m)) for m in history.machines())

def child(number, mode):
    pid = os.fork()
    if pid == 0:
        code = 0
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        shim.fault_arm(ctypes.c_long(number), mode)
        try:
            act()
        except InputError as error:
            code = 3
        except BaseException as error:
            code = 4
        finally:
            if number > 10**6:
                (root / "count").write_text(str(shim.fault_count()))
            os._exit(code)
    return os.waitpid(pid, 0)[1]

begin()
before = History(place / "history").__enter__().digest()
assert child(10**9, 0) == 0
count = int((root / "count").read_text())
with History(place / "history") as history:
    after = history.digest()
problems, killed, refused = [], 0, 0
for mode in (0, 1, 2):
    for number in range(1 + mode % every, count + 1, every):
        begin()
        status = child(number, mode)
        killed += os.WIFSIGNALED(status)
        if os.WIFEXITED(status):
            refused += os.WEXITSTATUS(status) == 3
            if os.WEXITSTATUS(status) == 4:
                problems.append(("traceback", mode, number))
        folders, events = records()
        with History(place / "history") as history:
            if seen(history) != (folders, len(events)):
                problems.append(("lost or doubled", mode, number, seen(history), folders))
            if verb == "rebuild" and history.digest() != before:
                problems.append(("half rebuilt", mode, number))
        for folder in folders:
            read_record(Path(folder))
        act()
        with History(place / "history") as history:
            if history.digest() != after:
                problems.append(("not completed", mode, number))
        left = [p.name for p in place.rglob(".*.writing")]
        if left:
            problems.append(("left behind", mode, number, left))
print(json.dumps({"count": count, "killed": killed, "refused": refused, "problems": problems[:5]}))
'''


@pytest.fixture(scope="module")
def shim(tmp_path_factory) -> Path:
    if COMPILER is None or sys.platform != "linux":
        pytest.skip("Skipped (optional): no C compiler, or not Linux.")
    target = tmp_path_factory.mktemp("shim") / "shim.so"
    subprocess.run([COMPILER, "-shared", "-fPIC", "-o", str(target), str(SHIM), "-ldl"], check=True)
    return target


def faults(shim: Path, root: Path, verb: str, every: int) -> dict:
    from symfive.history import Details, History

    place = root / "place"
    for number in range(1, 5):
        results(place / f"r{number}", number)
    os.utime(place / "r3" / "model.json", (1.6e9, 1.6e9))
    os.utime(place / "r4" / "model.json", (1.7e9, 1.7e9))
    with History(place / "history", create=True) as history:
        for number, time in ((1, 1.4e9), (2, 1.5e9)):
            history.add(place / f"r{number}", Details(time=time))
    shutil.copytree(place, root / "start")
    done = subprocess.run(
        [sys.executable, "-c", DRIVER, str(root), verb, str(every)], capture_output=True, text=True,
        env={**os.environ, "LD_PRELOAD": str(shim)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["add", "event", "rebuild"])
def test_a_sample_of_kills_and_full_disks(shim, tmp_path, verb):
    found = faults(shim, tmp_path, verb, every=9)
    assert found["problems"] == [] and found["killed"] >= 4 and found["refused"] >= 1, found


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["add", "event", "rebuild"])
def test_every_kill_and_every_full_disk(shim, tmp_path, verb, record_property):
    found = faults(shim, tmp_path, verb, every=1)
    record_property("faults", found["count"])
    assert found["problems"] == [] and found["killed"] >= found["count"], found
