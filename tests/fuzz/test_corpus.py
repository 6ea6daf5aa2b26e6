"""The kept corpus again and again: what the fuzzer once found stays mended. Needs no fuzzer."""

import warnings

import pytest

from symfive.errors import InputError

from .__main__ import main
from .bundle import unpack
from .checks import Fault, Reader, run
from .corpus import KEPT, OPEN, inputs
from .mutate import Mutator
from .readers import READERS


@pytest.mark.parametrize("name", READERS)
def test_the_kept_corpus_is_read_or_refused(tmp_path, name):
    kept = {path.name: path.read_bytes() for path in inputs(KEPT / name)}
    seeds = {f"seed {number}": data for number, data in enumerate(READERS[name].seeds())}
    assert kept
    outcomes = set()
    for file, data in {**kept, **seeds}.items():
        try:
            outcomes.add(run(READERS[name], data, tmp_path / "room"))
        except Exception as error:
            raise AssertionError(f"{name}, {file}: {error!r}") from error
    assert outcomes == {"read", "refused"}


def test_the_corpus_is_small_and_text():
    files = [path for folder in (KEPT, OPEN) for path in folder.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 300_000
    assert {path.parent.name for path in files} <= set(READERS)
    for path in files:
        assert "\0" not in path.read_bytes().decode()


def test_what_is_kept_as_an_open_fault_still_is_one(tmp_path):
    """Once it is mended, its file moves to the kept corpus."""
    for path in sorted(OPEN.glob("*/*.txt")):
        with pytest.raises(Exception):  # noqa: B017 (whatever it is)
            run(READERS[path.parent.name], path.read_bytes(), tmp_path / "room")


def nothing(*_):
    return None


def refuse(folder):
    raise InputError("it is wrong", path=folder / "x", remedy="correct it")


def tell_no_file(folder):
    raise InputError("it is wrong", remedy="correct it")


def give_no_remedy(folder):
    raise InputError("it is wrong", path=folder / "x")


def name_no_such_line(folder):
    raise InputError("it is wrong", path=folder / "x", line=9, remedy="correct it")


def write_beside(found, target):
    (target.parent / "escaped").write_text("")


def reader(read=nothing, check=nothing) -> Reader:
    return Reader(
        put=lambda data, folder: (folder / "x").write_bytes(data), read=read, check=check, seeds=lambda: iter(())
    )


def test_what_is_right_is_no_fault(tmp_path):
    assert run(reader(), b"", tmp_path / "room") == "read"
    assert run(reader(refuse), b"", tmp_path / "room") == "refused"


@pytest.mark.parametrize(
    ("read", "check", "fault"),
    [
        (lambda folder: [][1], nothing, IndexError),
        (lambda folder: warnings.warn("odd", stacklevel=1), nothing, UserWarning),
        (tell_no_file, nothing, Fault),
        (give_no_remedy, nothing, Fault),
        (name_no_such_line, nothing, Fault),
        (lambda folder: (folder / "y").write_text(""), nothing, Fault),
        (nothing, write_beside, Fault),
        (nothing, lambda found, target: refuse(target), InputError),
    ],
)
def test_what_is_wrong_is_a_fault(tmp_path, read, check, fault):
    with pytest.raises(fault):
        run(reader(read, check), b"", tmp_path / "room")


def test_a_bundle_stays_in_its_folder(tmp_path):
    unpack(b"x\n=== a.csv\n1\n=== ../b\n2\n=== /c\n3\n=== d/e\n4\n=== d\n5\n=== a.csv/f\n6\n", tmp_path / "in")
    written = {p.relative_to(tmp_path).as_posix(): p.read_text() for p in tmp_path.rglob("*") if p.is_file()}
    assert written == {"in/a.csv": "1\n", "in/d/e": "4\n"}


def test_mutations_follow_their_seed():
    seeds = list(READERS["recording"].seeds())
    mutator = Mutator(("t_s",), seeds)
    changed = [mutator(seeds[0], seed) for seed in range(200)]
    assert changed == [mutator(seeds[0], seed) for seed in range(200)]
    assert len(set(changed)) > 100


def test_the_command_says_what_it_needs(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["fuzz", "--reader", "nobody"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2 and "no reader nobody" in capsys.readouterr().err
