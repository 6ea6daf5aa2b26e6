"""Generated C against the limits of the computer and against other ways to the same Jacobian, in one run on one core.

    .venv/bin/python benchmarks/codegen.py [--quick] [--peers PYTHON] [--march SET ...]

Chain of five axes with six exact errors each: the point (3) and its Jacobian by 30 parameters, 10⁵ poses. `--peers` names a
Python with pinocchio (`pip install pin`), JAX, SymForce, CppADCodeGen (`cmeel-cppadcodegen`), Drake and frax; what is not
there is skipped and said. `--march x86-64-v3 x86-64-v4` measures kernel, limits and CasADi's C by each of these instruction
sets in one run. Least processor time of several repetitions; ratios travel between machines, nanoseconds do not.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import casadi as ca
import numpy as np
from chains import COMPLEX, JAX, SYMFORCE
from loops import LIMITS, LOOPS
from robots import CPPADCODEGEN, DRAKE, FRAX, PINOCCHIO, PINOCCHIO_JOINTS
from timing import timed

from symfive.codegen import Subject, codegen, subject_of
from symfive.codegen._sources import Sources
from symfive.codegen.c import Batch, c_files
from symfive.machine import ErrorTerm, preset
from symfive.parameters import Parameter

POSES = 100_000
EIGEN = Path(ca.__file__).parent / "include" / "eigen3"
TOOL = (0.0, 0.0, -150.0)


class Constant(Subject):
    """A machine whose six error motions of every axis are constants: the peers' chain, exact in all 30 parameters."""

    def row(self, q: Any, p: Any, tool: Any = (0.0, 0.0, 0.0)) -> Any:
        """The chain with those constants as error motions."""
        row = super().row(q, p, tool)
        for i, parameter in enumerate(self.parameters):
            row.add_motion(parameter.name, parameter.scale * p[i])
        return row


def subject() -> Subject:
    """The chain of all comparisons."""
    machine = replace(preset("table-bc"), errors={})
    names = [f"E{c}{axis}" for axis in machine.axis_names for c in "XYZABC"]
    parameters = tuple(Parameter(name=n, unit="um" if n[1] in "XYZ" else "urad", sigma=10.0) for n in names)
    return Constant(
        machine=machine,
        parameters=parameters,
        values=(0.0,) * 30,
        effects=(),
        left_out=(),
        fitted=False,
        covariance=None,
        digest="benchmark",
    )


def best(work: Callable[[], Any], repeat: int, poses: int = POSES) -> float:
    """Least processor time per pose, ns."""
    return 1e9 * timed(work, repeat)[0] / poses


def compiled(source: str, folder: Path, name: str, *flags: str, march: str = "native") -> ctypes.CDLL:
    """A C text as a loaded library."""
    (folder / f"{name}.c").write_text(source)
    library = folder / f"{name}.so"
    command = ["gcc", "-std=gnu99", "-w", *flags, f"-march={march}", "-shared", "-fPIC", f"{name}.c"]
    subprocess.run([*command, "-o", str(library), "-lm"], cwd=folder, check=True)
    return ctypes.CDLL(str(library))


def line(text: str, value: str, against: str = "") -> None:
    """One line of the table."""
    print(f"  {text:66}{value:>12}  {against}", flush=True)


def main() -> None:
    """All measurements."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--quick", action="store_true", help="fewer repetitions")
    options.add_argument("--peers", default=sys.executable, help="a Python with pinocchio and JAX")
    options.add_argument("--march", nargs="+", default=["native"], help="instruction sets that GCC knows")
    chosen = options.parse_args()
    if shutil.which("gcc") is None:
        sys.exit("gcc is not installed: there is nothing to measure")
    with tempfile.TemporaryDirectory() as name:
        for march in chosen.march:
            folder = Path(name) / march
            folder.mkdir()
            compared(folder, chosen.peers, chosen.quick, march)
        scalar(folder, 2 if chosen.quick else 5)
        large(folder, chosen.quick)


def compared(folder: Path, python: str, quick: bool, march: str = "native") -> dict[str, float | str]:
    """The batch kernel, its limits and the peers, ns a pose, by the instructions of `march`; for a missing peer the reason.

    Pins this process to one core.
    """
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    for file, text in c_files(subject(), "sf").items():
        (folder / file).write_text(text)
    kernel, store = batch(folder, 3 if quick else 9, march)
    return {**kernel, **peers(folder, kernel, store, python, 2 if quick else 5, march)}


def poses() -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 5) in mm and rad, and parameters (30)."""
    generator = np.random.default_rng(0)
    return generator.normal(size=(POSES, 5)) * [100.0, 100.0, 1.0, 1.0, 100.0], 10.0 * generator.normal(size=30)


def batch(folder: Path, repeat: int, march: str) -> tuple[dict[str, float], Callable[[], Any]]:
    """The vector kernel against write bandwidth and arithmetic; returns ns a pose, and a call that stores all of J."""
    sources = Sources(subject(), "sf")
    made = Batch(sources)
    spec = importlib.util.spec_from_file_location("sf", folder / "sf.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    kernel, p_ = module.Batch(module.build_batch(compiler="gcc", flags=(f"-march={march}",))), module._pointer
    limits = compiled(LIMITS, folder, "limits", "-O2", march=march)
    limits.multiply_add_limit.restype = ctypes.c_double
    q, p = poses()
    tiles, c = kernel._tiles(q), kernel._prepared(TOOL, p)
    count, lanes = ctypes.c_size_t(len(tiles)), kernel.lanes
    position, by_p = module._aligned((len(tiles), 3, lanes)), module._aligned((len(tiles), 90, lanes))
    target, normal = module._aligned((len(tiles), 3, lanes)), module._aligned((31, 31))
    everything = module._aligned((len(tiles), 93, lanes))
    work, step = module._aligned((int(made.names["vectors"]), lanes)), np.ones(30)
    for array in (position, by_p, target, normal, everything):
        array[...] = 0.0
    flop = made.operations
    turns = 2_000_000
    stores, fetched, past, kept, products, sums, points, leverages, multiplied = ([] for _ in range(9))
    factor, leverage = np.linalg.cholesky(np.eye(30) + 0.01), module._aligned((len(tiles), 6, lanes))
    leverage[...] = 0.0
    for _ in range(repeat):  # in turns, so that all see the same neighbours
        multiplied.append(timed(lambda: limits.multiply_add_limit(ctypes.c_size_t(turns)), 1)[0])
        stores.append(best(lambda: limits.write_limit(p_(everything), ctypes.c_size_t(everything.size // lanes)), 1))
        fetched.append(
            best(lambda: limits.fetched_write_limit(p_(everything), ctypes.c_size_t(everything.size // lanes)), 1)
        )
        past.append(best(lambda: kernel._function("jacobian")(count, *map(p_, (tiles, c, position, by_p)), 1), 1))
        kept.append(best(lambda: kernel._function("jacobian")(count, *map(p_, (tiles, c, position, by_p)), 0), 1))
        leverages.append(
            best(
                lambda: kernel._function("leverage")(
                    count, *map(p_, (tiles, c, factor)), ctypes.c_size_t(30), *map(p_, (leverage, work))
                ),
                1,
            )
        )
        products.append(best(lambda: kernel._function("predict")(count, *map(p_, (tiles, c, step, position))), 1))
        sums.append(
            best(
                lambda: kernel._function("information")(
                    ctypes.c_size_t(POSES), *map(p_, (tiles, c, target, normal, work))
                ),
                1,
            )
        )
        points.append(best(lambda: kernel._function("forward")(count, *map(p_, (tiles, c, position))), 1))
    peak = turns * 10 * 2 * lanes / min(multiplied) / 1e9
    print(f"\nBatch kernel for {march}: {POSES} poses, {flop} operations a pose, {lanes} poses a vector; ns a pose")
    line("write bandwidth, 93 doubles a pose, past the caches", f"{min(stores):.1f}")
    line("  through them, fetched ahead", f"{min(fetched):.1f}")
    text = "{:.2f} x its write limit (target 1.15)"
    line("point and J stored past the caches", f"{min(past):.1f}", text.format(min(past) / min(stores)))
    line("point and J stored through them, fetched ahead", f"{min(kept):.1f}", text.format(min(kept) / min(fetched)))
    line(f"arithmetic limit at {peak:.0f} Gflop/s of multiply-add", f"{flop / peak:.1f}")
    found = {"used limit": (flop + 180) / peak, "sums limit": (flop + 3 * 31 * 32) / peak}
    for text, values, more in (
        ("J d, J used in the tile", products, 180),
        ("J'J, J'r, r'r, J used in the tile", sums, 3 * 31 * 32),
        ("leverage J F F'J', 30 columns of F, J used in the tile", leverages, 2 * 30 * 90 + 360),
    ):
        limit = (flop + more) / peak
        line(
            f"{text} ({flop + more} operations)",
            f"{min(values):.1f}",
            f"{min(values) / limit:.2f} x the limit (target 2.2)",
        )
    line("point alone", f"{min(points):.1f}")
    few = ctypes.c_size_t(512 // lanes)
    small = best(
        lambda: [kernel._function("jacobian")(few, *map(p_, (tiles, c, position, by_p)), 0) for _ in range(100)],
        repeat,
        51200,
    )
    line("point and J stored, 512 poses again and again (in the cache)", f"{small:.1f}")
    stored = [0, 1][min(past) < min(kept)]
    found |= {"stored": min(kept + past), "used": min(products), "cached": small, "sums": min(sums)}
    found |= {
        "past": min(past),
        "past limit": min(stores),
        "kept": min(kept),
        "kept limit": min(fetched),
        "Gflop/s": peak,
    }
    return found, (lambda: kernel._function("jacobian")(count, *map(p_, (tiles, c, position, by_p)), stored))


def peers(
    folder: Path, kernel: dict[str, float], store: Callable[[], Any], python: str, repeat: int, march: str
) -> dict[str, float | str]:
    """The same Jacobian by others: ns a pose by name, or why it was skipped."""
    print("\nThe same point and Jacobian by others; ns a pose, and how many times ours takes less")
    q, p = poses()
    np.save(folder / "q.npy", q)
    np.save(folder / "p.npy", p)
    function = _casadi(folder)
    loops = compiled(LOOPS, folder, "loops", "-O3", "sf.c", march=march)
    position, by_p = np.empty((POSES, 3)), np.empty((POSES, 90))
    arrays = [np.ascontiguousarray(x) for x in (q, TOOL, p)]
    call = [ctypes.c_size_t(POSES), *(x.ctypes.data_as(ctypes.c_void_p) for x in (*arrays, position, by_p))]
    pairs = [(best(lambda: loops.casadi_all(*call), 1), best(store, 1)) for _ in range(3 * repeat)]  # same neighbours
    value, ours = (min(times) for times in zip(*pairs, strict=True))
    ratios = np.sort([theirs / own for theirs, own in pairs])
    text = f"{value / ours:.1f} x (target 7); pair by pair {ratios[0]:.1f} ... {np.median(ratios):.1f} ... {ratios[-1]:.1f} x"
    line(f"CasADi's generated C, cse, tight loop, -O3 -march={march}", f"{value:.0f}", text)
    told: dict[str, float | str] = {"ours": ours, "CasADi compiled": value, "CasADi pairs": float(np.median(ratios))}
    line("  against J used in the tile", "", f"{value / kernel['used']:.1f} x")
    call[0] = ctypes.c_size_t(512)
    value = best(lambda: [loops.casadi_all(*call) for _ in range(100)], repeat, 51200)
    line("  the same, 512 poses again and again (in the cache)", f"{value:.0f}", f"{value / kernel['cached']:.1f} x")
    mapped = function.map(POSES)
    inputs = [ca.DM(q.T), ca.DM(np.repeat([TOOL], POSES, axis=0).T), ca.DM(np.repeat(p[:, None], POSES, axis=1))]
    value = best(lambda: mapped(*inputs), 2)
    line("CasADi .map(100000)", f"{value:.0f}", f"{value / ours:.0f} x (target 80)")
    told["CasADi map"] = value
    scripts = (("pinocchio: forward kinematics and joint regressor, Python loop", PINOCCHIO, 20_000, " (target 25)"),
               ("SymForce: generated C++, tight loop, -O3", SYMFORCE, POSES, ""),
               ("CppADCodeGen: generated C, tight loop, -O3", CPPADCODEGEN, POSES, ""),
               ("JAX: jit(vmap(jacrev))", JAX, 20_000, ""), ("numpy, complex step, batched", COMPLEX, 5000, ""),
               ("by 5 joints only: pinocchio, Python loop", PINOCCHIO_JOINTS, 20_000, ""),
               ("by 5 joints only: Drake, Python loop", DRAKE, 20_000, ""),
               ("by 5 joints only: frax, jit(vmap)", FRAX, 20_000, ""))  # fmt: skip
    wanted = by_p[:50].reshape(50, 30, 3).transpose(0, 2, 1)
    for text, script, count, target in scripts:
        (folder / "peer.py").write_text(script)
        found = folder / "found.npy"
        found.unlink(missing_ok=True)
        command = [python, "peer.py", str(count), "q.npy", "p.npy", str(found), march, str(EIGEN)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode:
            told[text] = "skipped: " + done.stderr.strip().splitlines()[-1]
            line(text, "skipped", str(told[text]))
            continue
        told[text] = value = 1e9 * float(done.stdout.split()[-1])
        line(text, f"{value:.0f}", f"{value / ours:.0f} x{target}")
        if found.exists():
            apart = np.abs(np.load(found) - wanted).max()
            assert apart < 1e-9, f"{text} computes something else ({apart})"
    return told


def _casadi(folder: Path) -> ca.Function:
    """CasADi's own C of the same outputs, by automatic differentiation."""
    q, tool, p = ca.SX.sym("q", 5), ca.SX.sym("tool", 3), ca.SX.sym("p", 30)
    position, _, _, by_p = subject().function()(q, tool, p)
    generator = ca.CodeGenerator("casadi.c", {"casadi_int": "long long"})
    function = ca.Function("jacobian", [q, tool, p], [position, by_p], {"cse": True})
    generator.add(function)
    generator.add(ca.Function("point", [q, tool, p], [position], {"cse": True}))
    generator.generate(str(folder) + "/")
    return function


def scalar(folder: Path, repeat: int) -> None:
    """One call at a time: time and stack."""
    print("\nScalar C, one call at a time, gcc -O2: ns a call, bytes of stack")
    loops = compiled(LOOPS, folder, "loops2", "-O2", "-fno-inline", "-fstack-usage", "sf.c")
    q, p = poses()
    position, by_p = np.empty((POSES, 3)), np.empty((POSES, 90))
    arrays = [np.ascontiguousarray(x) for x in (q, TOOL, p)]
    call = [ctypes.c_size_t(POSES), *(x.ctypes.data_as(ctypes.c_void_p) for x in (*arrays, position, by_p))]
    used: dict[str, int] = {}
    for file in folder.glob("loops2*.su"):
        used |= {n: int(s) for n, s in re.findall(r":(\w+)(?:\.\S+)?\t(\d+)\t", file.read_text())}
    used["sf_inverse"] += used["approach"] + max(used["real_slope"], used["solve3"])  # along the calls
    rows = (
        ("forward, ours (point and direction)", "ours_forward", "sf_forward"),
        ("forward, CasADi (point)", "casadi_forward", "casadi_f1"),
        ("parameter Jacobian, ours", "ours_all", "sf_parameter_jacobian"),
        ("point and Jacobian, CasADi", "casadi_all", "casadi_f0"),
        ("compensated inverse, ours", "ours_inverse", "sf_inverse"),
    )
    for text, function, name in rows:
        value = best(lambda function=function: getattr(loops, function)(*call), repeat)
        line(text, f"{value:.0f}", f"{used[name]} bytes")


def _children() -> float:
    """Processor seconds of all programs called so far."""
    spent = os.times()
    return spent.children_user + spent.children_system


def large(folder: Path, quick: bool) -> None:
    """Machines with six error motions of every axis: generated, compiled, self-test."""
    print(
        "\nSix error motions of every axis: seconds to generate; to compile C and self-test; the batch kernel (target 10)"
    )
    nutating = preset("nutating-table")
    cases = [("wang-li-2016", preset("wang-li-2016"))]
    for basis in ("polynomial", "fourier"):
        motions = {f"E{c}{a}": ErrorTerm(name=f"E{c}{a}", sigma=10.0, basis=(basis,), order=(3,)) for a in nutating.axes
                   for c in "XYZABC"}  # fmt: skip
        errors = {**{t.name: t for t in nutating.location_errors}, **motions}
        cases.append((f"nutating table, {basis}, order 3", replace(nutating, errors=errors)))
    for i, (text, machine) in enumerate(cases[:1] if quick else cases):
        made, _ = timed(lambda: codegen(machine, folder / str(i)), 1)  # noqa: B023
        strict = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-O2"]
        start = _children()
        subprocess.run(
            ["gcc", *strict, "sf.c", "sf_selftest.c", "-lm", "-o", "selftest"], cwd=folder / str(i), check=True
        )
        fast = ["gcc", "-std=gnu99", "-O2", "-march=native", "-c", "sf_batch.c"]
        middle = _children()
        subprocess.run(fast, cwd=folder / str(i), check=True)
        end = _children()
        done = subprocess.run(["./selftest"], cwd=folder / str(i), capture_output=True, text=True)
        count = len(subject_of(machine).parameters)
        line(
            f"{text}: {count} parameters",
            f"{made:.1f} {middle - start:.1f} {end - middle:.1f}",
            "passed" if done.returncode == 0 else done.stdout,
        )


if __name__ == "__main__":
    main()
