"""The C compiler of this computer: which one, what it compiles for, and one call of it."""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from symfive.compiled.scalar import CALLS

SWITCH = "SYMFIVE_COMPILER"
"""The environment variable that names the compiler; `none` switches compiling off."""
PROGRAMS = ("cc", "gcc", "clang")
EXACT = ("sqrt", "fabs", "floor", "ceil")
"""Library functions whose result is defined to the last bit: the compiler's own will do."""
FLAGS = (
    "-std=gnu99", "-w", "-O1", "-march=native", "-fPIC", "-fno-math-errno", "-fno-fast-math", "-ffp-contract=off",
    # the same library functions as CasADi's, none of the compiler's own
    *(f"-fno-builtin-{name}" for name in CALLS if name not in EXACT),
)  # fmt: skip
ASK_S, COMPILE_S = 20.0, 120.0


@dataclass(frozen=True)
class Compiler:
    """A compiler that answers: `program` its path, `identity` a digest of version, processor and options."""

    program: str
    identity: str

    def compile(self, text: str, folder: Path) -> Path:
        """The shared library of a C text, made in a folder of its own. Raises `OSError` where that fails."""
        (folder / "rows.c").write_text(text, encoding="ascii")
        command = [self.program, *FLAGS, "-shared", "rows.c", "-o", "rows.so", "-lm"]
        _run(command, COMPILE_S, cwd=folder, env={**os.environ, "LC_ALL": "C", "TMPDIR": str(folder)})
        return folder / "rows.so"


def find_compiler() -> Compiler | None:
    """The compiler that `SYMFIVE_COMPILER` names, by default the first of cc, gcc and clang that answers; None without."""
    if os.name != "posix":
        return None
    wanted = os.environ.get(SWITCH, "")
    if wanted.lower() == "none":
        return None
    for name in (wanted,) if wanted else PROGRAMS:
        program = shutil.which(name)
        if program is not None and (identity := _identity(program)):
            return Compiler(program, identity)
    return None


@functools.lru_cache(maxsize=8)
def _identity(program: str) -> str:
    """All macros that the compiler defines: its version, the processor's instructions, how it counts."""
    try:
        macros = _run([program, *FLAGS, "-dM", "-E", "-x", "c", "-"], ASK_S)
    except OSError:
        return ""
    return hashlib.sha256(macros + " ".join(FLAGS).encode()).hexdigest()


def _run(command: list[str], seconds: float, **options: object) -> bytes:
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=seconds, **options)  # type: ignore[call-overload]
    except subprocess.TimeoutExpired:
        raise OSError(f"{command[0]} takes more than {seconds:.0f} s") from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise OSError(f"{command[0]} fails: {said[0] if said else done.returncode}")
    return bytes(done.stdout)
