#!/usr/bin/env python3
"""Everything from a fresh clone: `python3 go.py demo`, `test`, `lint`, `docs`, `designs`, `lock` or `sbom`.

The first start makes `.venv` and installs the locked packages there, each checked against its hash; later starts use it
at once. Only Python and its pip are needed: no ensurepip, no make, and nothing is installed outside the repository.
"""

import hashlib
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

if sys.version_info < (3, 11):  # noqa: UP036 - this file also runs where the package itself cannot
    sys.exit(f"go.py: symfive needs Python 3.11 or newer; {sys.executable} is {sys.version.split()[0]}.")

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
PYTHON = VENV / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
STAMP = VENV / f"installed-{sys.implementation.cache_tag}"  # "<fingerprint> <extra> <extra> ..."
LOCK = ROOT / "constraints.txt"
EXTRAS = ("build", "test", "lint", "docs", "dask", "history", "sbom", "lock")
FAST = "not slow and not linuxcnc"


def fail(sentence: str) -> NoReturn:
    """End with one sentence for the reader."""
    sys.exit(f"go.py: {sentence}")


def run(*arguments: str) -> int:
    """Run the environment's Python in the repository and return its exit code.

    One thread for BLAS: the matrices are small, and threads of several processes only hinder each other. Byte code is
    written whatever the environment says: the installation leaves it to the first import, and without it every
    process would compile CasADi's, SciPy's and Matplotlib's sources again.
    """
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    environment = {**one_thread, **os.environ}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    return subprocess.call([str(PYTHON), *arguments], cwd=ROOT, env=environment)


def fingerprint() -> str:
    """Digest of all that decides what gets installed, and where."""
    sources = [path.read_bytes() for path in (ROOT / "pyproject.toml", LOCK)]
    return hashlib.sha256(b"\0".join([*sources, sys.version.encode(), bytes(ROOT)])).hexdigest()


def require_pip() -> None:
    """Check that the interpreter running this file can install into another environment."""
    if Path(sys.prefix).resolve() == VENV:
        fail("the environment is out of date and cannot renew itself; run `deactivate`, then go.py again.")
    answer = subprocess.run([sys.executable, "-m", "pip", "--version"], capture_output=True, text=True).stdout
    version = [int(part) for part in re.findall(r"\d+", answer)[:2]]
    if not version:
        fail(f"{sys.executable} has no pip; install it first (Debian, Ubuntu: `apt install python3-pip`).")
    if version < [22, 3]:
        fail(f"pip 22.3 or newer is needed to install into .venv; {sys.executable} has {answer.strip()}.")


def prepare(extra: str) -> None:
    """Make `.venv` hold symfive with this extra.

    The stamp is removed first and written last: an interrupted installation leaves none and starts afresh.
    """
    installed = STAMP.read_text().split() if STAMP.exists() and PYTHON.exists() else []
    wanted = fingerprint()
    if installed[:1] == [wanted] and extra in installed:
        return
    require_pip()
    extras = sorted({extra, *installed[1:]})
    package = f".[{','.join(extras)}]"
    print(f"go.py: installing symfive{package[1:]} into .venv, about half a minute ...", flush=True)
    STAMP.unlink(missing_ok=True)
    if not installed:
        step("-m", "venv", "--without-pip", "--clear", str(VENV))
    wanted_packages = VENV / "requirements.txt"
    wanted_packages.write_text(locked("build", *extras))
    pip_install = ("-m", "pip", "--python", str(PYTHON), "install", "-q", "--disable-pip-version-check")
    # --no-compile: byte code comes with the first import; compiling all of it at once doubles the wait
    step(*pip_install, "--no-compile", "--require-hashes", "-r", str(wanted_packages))
    step(*pip_install, "--no-deps", "--no-build-isolation", "-e", package)
    STAMP.write_text(" ".join([wanted, *extras]))


def locked(*extras: str) -> str:
    """The part of the lock that symfive with these extras needs: pip requirements with hashes, for every platform."""
    import tomllib  # not at the top: an older Python has to reach the sentence above

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    direct = [*project["dependencies"], *(d for e in extras for d in project["optional-dependencies"][e])]
    needed = {plain_name(requirement) for requirement in direct}
    entries = re.findall(r"^[\w.-]+==.*?(?=^[\w.-]+==|\Z)", LOCK.read_text(encoding="utf-8"), re.M | re.S)
    texts = {plain_name(entry.split("==")[0]): entry for entry in entries}
    wanted_by = {name: set(re.findall(r"^ +# +(?:via +)?(\S+)", text, re.M)) for name, text in texts.items()}
    while more := {name for name, users in wanted_by.items() if name not in needed and users & needed}:
        needed |= more
    if needed - set(texts):
        fail(f"constraints.txt lacks {', '.join(sorted(needed - set(texts)))}; run `python3 go.py lock`.")
    return "".join(text for name, text in texts.items() if name in needed)


def plain_name(requirement: str) -> str:
    """The package's normalised name in a requirement such as `PyYAML>=6`."""
    return re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", requirement)[0]).lower()  # type: ignore[index]


def step(*arguments: str) -> None:
    """Run one step with the interpreter that runs this file; if it fails, quote its last error."""
    done = subprocess.run([sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        lines = [line.strip() for line in (done.stdout + done.stderr).splitlines() if line.strip()]
        errors = [line for line in lines if re.match(r"(ERROR|\w+Error): ", line)] or lines or ["no message"]
        doubt = " (no answer from the package index)" if "Retrying (" in done.stderr else ""
        fail(f"{arguments[1]} failed{doubt}: {errors[-1]}")


def demo(*arguments: str) -> int:
    """Run the demonstration."""
    prepare("test")
    return run("examples/demo/demo.py", *arguments)


def test(*arguments: str) -> int:
    """Run the quick tests, or all of them with --full; other arguments go to pytest."""
    prepare("test")
    if "--full" in arguments:
        prepare("dask")  # its tests are skipped where it is missing
    selection = [] if "--full" in arguments else ["-m", FAST]
    workers = ["-n", "auto", "--dist", "loadscope"]  # one process a core, a module's fixtures made once
    return run("-m", "pytest", *workers, *selection, *(word for word in arguments if word != "--full"))


def lint(*arguments: str) -> int:
    """Check style, layout and types."""
    prepare("lint")
    checks = (["ruff", "check"], ["ruff", "format", "--check"], ["mypy"])
    codes = [run("-m", *check, *arguments) for check in checks]
    return int(any(codes))


def docs(*arguments: str) -> int:
    """Build the pages in docs/ as HTML."""
    if not (ROOT / "docs").is_dir():
        fail("there is no docs/ folder to build.")
    prepare("docs")
    return run("-m", "sphinx", "-W", "--keep-going", "docs", "docs/_build/html", *arguments)


def designs(*arguments: str) -> int:
    """Make the ready plans in designs/plans anew: all of them, or `own`, `optimised` and names of folders."""
    prepare("test")
    return run("-m", "designs.plans.make_plans", *arguments)


def lock(*arguments: str) -> int:
    """Resolve the dependencies anew into constraints.txt, for every platform; `--upgrade` takes newer versions."""
    prepare("lock")
    extras = [word for extra in EXTRAS for word in ("--extra", extra)]
    command = ["pip", "compile", "pyproject.toml", "--universal", "--python-version", "3.11", "--generate-hashes"]
    own = ["--custom-compile-command", "python3 go.py lock", "--no-config", "-q", "-o", LOCK.name]
    return run("-m", "uv", *command, *own, *extras, *arguments)


def sbom(*arguments: str) -> int:
    """Write the software bill of materials of symfive and its extra dask (CycloneDX, JSON) from the lock: build/sbom.json."""
    prepare("sbom")
    (ROOT / "build").mkdir(exist_ok=True)
    wanted_packages = ROOT / "build" / "sbom-requirements.txt"
    wanted_packages.write_text(locked("dask"))
    words = ["requirements", str(wanted_packages), "--pyproject", "pyproject.toml", "--output-reproducible"]
    return run("-m", "cyclonedx_py", *words, "-o", "build/sbom.json", *arguments)


VERBS: dict[str, Callable[..., int]] = {
    "demo": demo,
    "test": test,
    "lint": lint,
    "docs": docs,
    "designs": designs,
    "lock": lock,
    "sbom": sbom,
}

if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in VERBS:
        fail(f"say what to do: python3 go.py {'|'.join(VERBS)} [arguments]")
    try:
        sys.exit(VERBS[sys.argv[1]](*sys.argv[2:]))
    except KeyboardInterrupt:
        sys.exit(130)
