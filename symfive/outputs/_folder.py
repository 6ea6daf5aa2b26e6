"""Writing: files and folders, whole or not at all, never over an input."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from symfive.errors import InputError
from symfive.outputs._manifest import MANIFEST, SCHEMA, command, cut, digest_of, manifest_of
from symfive.outputs._place import Output, alone, before_of, being_written, put, swap, sync, writing
from symfive.version import __version__


def write_bytes(path: Path, data: bytes, *, to_edit: bool = False) -> None:
    """Write a file: as part of the output that is open, else by itself, whole or not at all. `to_edit`: people change it."""
    write_parts(path, (data,), to_edit=to_edit)


def write_parts(path: Path, parts: Iterable[bytes], *, to_edit: bool = False) -> None:
    """Write a long file part by part, as `write_bytes` does."""
    output = being_written.get()
    if output is not None and output.holds(path):
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            put(path, parts)
        if to_edit:
            output.to_edit.add(Path(os.path.abspath(path)).relative_to(output.beside).as_posix())
        return
    target = Path(os.path.realpath(path))
    with writing(path), alone(target):
        beside = target.with_name(f".{target.name}.writing")
        try:
            put(beside, parts)
            os.replace(beside, target)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise


def write_text(path: Path, text: str, *, to_edit: bool = False) -> None:
    """Write text in UTF-8, as `write_bytes` does."""
    write_bytes(path, text.encode(), to_edit=to_edit)


def write_json(path: Path, data: Any) -> None:
    """Write JSON as `write_bytes` does; NaN and infinity are refused, dates become text."""
    write_text(path, json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False, default=str) + "\n")


@contextmanager
def output_file(target: Path) -> Iterator[Path]:
    """The path under which to write a file that becomes `target` when the block ends; one that exists is never replaced."""
    target = _real(target)
    with _place(target, False, False) as output:
        if os.path.lexists(target):
            problem = "a file or folder of that name exists"
            raise InputError(problem, path=target, remedy="name another, or remove it yourself")
        try:
            yield output.beside
            with writing(target):
                os.replace(output.beside, target)
        finally:
            output.beside.unlink(missing_ok=True)


@contextmanager
def output_folder(target: Path, *, overwrite: bool = False, recorded: bool = False) -> Iterator[Path]:
    """A folder that becomes `target`, with its manifest, when the block ends without an error; within one, a part of it.

    An existing folder is replaced only with `overwrite`, and only where symfive wrote its results and nobody changed them;
    what else lies there stays. `recorded`: they are readings of an instrument, which `overwrite` replaces only while
    their source is still there. What the block reads are the inputs. Raises `InputError`.
    """
    outer = being_written.get()
    if outer is not None and outer.holds(target):
        with writing(target):
            target.mkdir(parents=True, exist_ok=True)
        yield target
        return
    target = _real(target)
    with _place(target, overwrite, recorded) as output:
        _replaceable(output)
        number = 0
        try:
            with writing(target):
                os.mkdir(output.beside)
                number = output.beside.stat().st_ino
            yield output.beside
            with writing(target):
                _finish(output)
                swap(output)
        except BaseException as error:
            done = os.path.isdir(target) and target.stat().st_ino == number
            said = f"the results in {target} are complete" if done else f"nothing was written to {target}"
            error.add_note(said)
            raise
        finally:
            shutil.rmtree(output.beside, ignore_errors=True)


def _real(target: Path) -> Path:
    """The place itself. Raises `InputError` for a root, beside which nothing lies."""
    real = Path(os.path.realpath(target))
    if not real.name:
        raise InputError("a folder of that name exists", path=target, remedy="name a folder inside it")
    return real


@contextmanager
def _place(target: Path, overwrite: bool, recorded: bool) -> Iterator[Output]:
    """The output as the one that is open, its place nobody else's, what a crash left there cleaned."""
    output = Output(target, overwrite, recorded)
    with ExitStack() as stack:
        with writing(target):
            stack.enter_context(alone(target))
            before = before_of(target)
            if before.exists() and not target.exists():
                os.rename(before, target)
            for left in (before, output.beside):
                if left.is_dir():
                    shutil.rmtree(left)
                else:
                    left.unlink(missing_ok=True)
        token = being_written.set(output)
        try:
            yield output
        finally:
            being_written.reset(token)


def _replaceable(output: Output) -> list[str]:
    """What lies in the target and stays there. Raises `InputError` where the target must not be replaced."""
    target = output.target
    if not os.path.lexists(target):
        return []
    if not target.is_dir():
        raise InputError(
            "the output must be a folder, and a file of that name exists", path=target, remedy="name another"
        )
    if Path.cwd().is_relative_to(target):
        problem = "the output is the folder that you are in, or holds it"
        raise InputError(problem, path=target, remedy="name a folder inside yours")
    files = [p.relative_to(target).as_posix() for p in sorted(target.rglob("*")) if p.is_symlink() or not p.is_dir()]
    if not files:
        return []
    manifest = manifest_of(target)
    if manifest is None:
        problem = f"the folder holds files that no {MANIFEST} lists, as {cut(files[0])}: yours, or results of an older version"
        raise InputError(problem, path=target, remedy="move the folder away yourself, or name another")
    if not output.overwrite:
        raise InputError("results lie there already", path=target, remedy="name another folder, or give --overwrite")
    inputs = ((Path(name), digest) for name, digest in manifest.get("inputs", {}).items())
    if manifest.get("recorded") and not all(path.is_file() and digest_of(path) == digest for path, digest in inputs):
        problem = "readings lie there whose source is gone or was changed"
        raise InputError(problem, path=target, remedy="name another folder, or remove this one yourself")
    known = {**manifest["outputs"], **manifest["to_edit"]}
    for name in files:
        if name in known and digest_of(target / name) != known[name]:
            problem = "the file was changed since symfive wrote it, and would be replaced"
            raise InputError(problem, path=target / name, remedy="name another folder, or remove this one yourself")
    # Python's caches hold what the files replaced were, and a file of the same second and size would be taken for its forerunner
    return [name for name in files if name not in known and name != MANIFEST and "__pycache__" not in name.split("/")]


def _finish(output: Output) -> None:
    """The manifest, and beside the results what else lies in the target."""
    written = sorted(p for p in output.beside.rglob("*") if p.is_file())
    digests = {p.relative_to(output.beside).as_posix(): digest_of(p) for p in written}
    manifest = {
        "schema": SCHEMA,
        "version": __version__,
        "command": command.get(),
        "recorded": output.recorded,
        "inputs": output.read,
        "outputs": {name: digest for name, digest in digests.items() if name not in output.to_edit},
        "to_edit": {name: digest for name, digest in digests.items() if name in output.to_edit},
    }
    put(output.beside / MANIFEST, [(json.dumps(manifest, indent=1, ensure_ascii=False) + "\n").encode()])
    for name in _replaceable(output):
        here, there = output.target / name, output.beside / name
        if os.path.lexists(there):
            raise InputError("a file of yours would be replaced", path=here, remedy="move it away")
        there.parent.mkdir(parents=True, exist_ok=True)
        if here.is_symlink():
            os.symlink(os.readlink(here), there)
        else:
            try:
                os.link(here, there)
            except OSError:  # a file system without links
                shutil.copy2(here, there)
    for folder in (output.beside, *(p for p in output.beside.rglob("*") if p.is_dir())):
        sync(folder)
