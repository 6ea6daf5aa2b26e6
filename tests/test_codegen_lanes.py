"""The batch kernel for every instruction set: as many poses a vector as a register holds, no ABI warning, the same results."""

import platform
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from codegen_world import TOOL, compiles, fitted, loaded, needs, run

from symfive.codegen import codegen, subject_of
from symfive.machine import preset

DRIVER = Path(__file__).parent / "data" / "batch_driver.c"
WARNINGS = ("-std=gnu99", "-O2", "-Wall", "-Wextra", "-Wpsabi", "-Werror")
SETS = {"x86-64-v2": 2, "x86-64-v3": 4, "x86-64-v4": 8}
NEEDED = {"x86-64-v2": "sse4_2", "x86-64-v3": "avx2", "x86-64-v4": "avx512vl"}
POSES, RANK = 203, 7


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lanes") / "c"
    codegen(fitted(preset("tsutsumi-2007")), folder)
    shutil.copy(DRIVER, folder)
    return folder


@pytest.fixture(scope="module")
def expected(sources: Path) -> dict[str, np.ndarray]:
    """The driver's input, and what the symbolic model says to it by automatic differentiation."""
    subject = subject_of("tsutsumi-2007")
    p = np.array([fitted(preset("tsutsumi-2007")).values[n] for n in loaded(sources / "sf.py").PARAMETERS])
    generator = np.random.default_rng(1)
    ends = np.array([[v * a.to_internal for v in a.travel] for a in (subject.machine.axes[n] for n in subject.axes)])
    q = generator.uniform(ends[:, 0], ends[:, 1], size=(POSES, len(ends)))
    step, factor = p * generator.normal(size=len(p)), generator.normal(size=(len(p), RANK))
    reference = subject.function()
    results = [reference(row, TOOL, p) for row in q]
    points = np.array([np.asarray(r[0])[:, 0] for r in results])
    by_p = np.array([np.asarray(r[3]) for r in results])
    columns = np.concatenate([by_p, generator.normal(size=(POSES, 3, 1))], axis=2)
    target = points + columns[:, :, -1]
    jacobian = by_p.transpose(0, 2, 1).reshape(POSES, -1)
    given = (np.array([POSES, RANK]), np.array(TOOL), p, step, factor, q, target)
    upper = np.triu_indices(3)
    return {
        "in": np.concatenate([np.ravel(part) for part in given]).astype(float),
        "points": points, "points with J": points, "J": jacobian, "points with J past": points, "J past": jacobian,
        "predicted": points + by_p @ step, "information": np.einsum("nij,nik->jk", columns, columns),
        "leverage": (by_p @ (factor @ factor.T) @ by_p.transpose(0, 2, 1))[:, upper[0], upper[1]],
    }  # fmt: skip


@cache
def cpu_flags() -> set[str]:
    told = Path("/proc/cpuinfo")
    lines = told.read_text().splitlines() if told.exists() else []
    return set(next((line for line in lines if line.startswith("flags")), "").split())


def driven(folder: Path, expected: dict[str, np.ndarray], *emulator: str) -> int:
    """Run the driver, compare all that it says with the model; the lanes that it says."""
    expected["in"].tofile(folder / "in")
    run(*emulator, "./driver", "in", "out", cwd=folder)
    found, place = np.fromfile(folder / "out"), 1
    for name, wanted in expected.items():
        if name != "in":
            part = found[place : place + wanted.size].reshape(wanted.shape)
            place += wanted.size
            assert np.abs(part - wanted).max() < 1e-12 * max(1e3, np.abs(wanted).max()), name
    assert place == found.size
    return int(found[0])


def built(folder: Path, sources: Path, compiler: str, *flags: str) -> None:
    needs(compiler)
    parts = [sources / "sf_batch.c", sources / "batch_driver.c"]
    run(compiler, *WARNINGS, *flags, f"-I{sources}", *parts, "-o", "driver", "-lm", cwd=folder)


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="not an x86-64 processor")
@pytest.mark.parametrize(
    ("march", "compiler"),
    [*((march, "gcc") for march in (*SETS, "native")), ("native", "clang"),
     *(pytest.param(march, "clang", marks=pytest.mark.slow) for march in SETS)],
)  # fmt: skip
def test_every_instruction_set_of_x86(tmp_path, sources, expected, compiler, march) -> None:
    built(tmp_path, sources, compiler, f"-march={march}")
    if march in SETS and NEEDED[march] not in cpu_flags():
        pytest.skip(f"compiled without a warning; this processor cannot run {march}")
    widest = max((SETS[name] for name in SETS if NEEDED[name] in cpu_flags()), default=2)
    assert driven(tmp_path, expected) == SETS.get(march, widest)
    words = run("objdump", "-d", "driver", cwd=tmp_path) if shutil.which("objdump") else ""
    register = {2: "xmm", 4: "ymm", 8: "zmm"}
    assert not words or register[SETS.get(march, widest)] in words
    assert not any(register[lanes] in words for lanes in register if lanes > SETS.get(march, widest))


@pytest.mark.parametrize("lanes", [1, 2])
def test_fewer_lanes_than_the_processor_has(tmp_path, sources, expected, lanes) -> None:
    built(tmp_path, sources, "gcc", f"-DSF_LANES={lanes}")
    assert driven(tmp_path, expected) == lanes


def test_neon(tmp_path, sources, expected) -> None:
    needs("aarch64-linux-gnu-gcc", "qemu-aarch64")
    if not compiles("aarch64-linux-gnu-gcc"):
        pytest.skip("the C library's headers for aarch64 are not installed")
    built(tmp_path, sources, "aarch64-linux-gnu-gcc", "-static")
    assert driven(tmp_path, expected, "qemu-aarch64") == 2


def test_tiles_of_another_size_are_refused(tmp_path, sources) -> None:
    """More lanes than a register has are not compiled; a program with other tiles than the kernel's is not linked."""
    needs("gcc")
    for wrong, says in (
        (["-c", "-DSF_LANES=16", sources / "sf_batch.c"], "no registers of so many doubles"),
        (["-DSF_LANES=1", sources / "batch_driver.c", "kernel.o"], "undefined reference"),
    ):
        run("gcc", "-O0", "-DSF_LANES=2", "-c", sources / "sf_batch.c", "-o", "kernel.o", cwd=tmp_path)
        command = ["gcc", f"-I{sources}", *map(str, wrong), "-lm", "-o", "driver"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode != 0 and says in done.stderr
