"""Generated C builds: without a word, tested by itself, small, clean, the same bytes, and no wrong library is loaded."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import codegen_world
import numpy as np
import pytest
from codegen_world import STRICT, TOOL, fitted, loaded, needs, run

from symfive.codegen import TARGETS, codegen, subject_of
from symfive.machine import preset, presets
from symfive.model import write_model

compiled = codegen_world.compiled  # fixture

COMPILERS = ("gcc", "clang")
LIBM = {"sin", "cos", "sincos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "sqrt", "pow", "fabs", "floor",
        "ceil", "fmin", "fmax", "sinh", "cosh", "tanh"}  # fmt: skip


@pytest.mark.parametrize(("compiler", "precision"), [("gcc", "double"), ("clang", "float")])
def test_it_compiles_without_a_word_and_passes_its_self_test(compiled, compiler, precision) -> None:
    _compile_and_test(compiled.folder("head-bc"), compiler, precision)


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("name", presets())
def test_every_preset_compiles_and_passes_its_self_test(compiled, name, compiler, precision) -> None:
    _compile_and_test(compiled.folder(name), compiler, precision)


def _compile_and_test(folder: Path, compiler: str, precision: str) -> None:
    needs(compiler, "nm")
    switch = ["-DSF_FLOAT"] if precision == "float" else []
    run(compiler, *STRICT, *switch, "-O2", "-fno-pie", "-c", "sf.c", "-o", f"sf-{precision}.o", cwd=folder)
    sources = ("sf_selftest.c", f"sf-{precision}.o")
    run(compiler, *STRICT, *switch, "-O2", *sources, "-lm", "-no-pie", "-o", "selftest", cwd=folder)
    assert "0 failures" in run("./selftest", cwd=folder)
    imports = set(run("nm", "-u", f"sf-{precision}.o", cwd=folder).split()) - {"U", "memset", "memcpy"}
    allowed = {f"{name}f" for name in LIBM} if precision == "float" else LIBM
    assert imports <= allowed, f"{precision} imports {imports - allowed}"
    defined = run("nm", f"sf-{precision}.o", cwd=folder)
    assert not re.search(r" [BbDdC] ", defined), "there is a variable that outlives a call"


def test_a_wrong_library_fails_its_self_test(compiled, tmp_path) -> None:
    needs("gcc")
    shutil.copytree(compiled.folder("three-axis"), tmp_path / "wrong")
    source = tmp_path / "wrong" / "sf.c"
    text = source.read_text()
    changed = text.replace("(sf_real)(0.001)", "(sf_real)(0.0010001)", 1)
    assert changed != text
    source.write_text(changed)
    run("gcc", "sf_selftest.c", "sf.c", "-lm", "-o", "selftest", cwd=source.parent)
    done = subprocess.run(["./selftest"], cwd=source.parent, capture_output=True, text=True)
    assert done.returncode == 1
    assert "off by" in done.stdout


def test_the_stack_stays_below_what_the_header_says(compiled) -> None:
    needs("gcc")
    folder = compiled.folder("table-bc")
    said = dict(
        re.findall(
            r"\* +\(?(?:sf_)?(\w+)\)?: \d+ operations, \d+ live, at most (\d+) bytes", (folder / "sf.h").read_text()
        )
    )
    assert {"forward", "parameter_jacobian", "real_slope"} <= set(said)
    for level in ("-O0", "-O2"):
        run("gcc", "-std=c99", level, "-fstack-usage", "-c", "sf.c", "-o", "stack.o", cwd=folder)
        used = re.findall(r":(?:sf_)?(\w+)\t(\d+)\tstatic", next(folder.glob("*.su")).read_text())
        for name, size in used:
            if name in said:
                assert int(size) <= int(said[name]), f"{name} at {level}"
        path = ("inverse", "approach", "solve3", "largest", "real_slope")
        assert sum(int(size) for name, size in used if name in path) <= int(said["real_slope"]) + 1000


@pytest.mark.slow
def test_cppcheck_finds_nothing_that_matters(compiled) -> None:
    """MISRA C:2012 as far as cppcheck's addon goes; what remains belongs to checking one file alone."""
    needs("cppcheck")
    for precision in (["-USF_FLOAT"], ["-DSF_FLOAT"]):
        done = subprocess.run(
            ["cppcheck", "--std=c99", "--enable=warning,style,performance,portability", "--addon=misra", "--template={id}",
             "--suppress=missingIncludeSystem", *precision, "sf.c"],
            cwd=compiled.folder("head-bc"), capture_output=True, text=True,
        )  # fmt: skip
        found = {line for line in done.stderr.splitlines() if re.fullmatch(r"[\w.-]+", line)}
        assert found <= {"misra-c2012-2.5", "misra-c2012-8.7", "misra-config", "normalCheckLevelMaxBranches"}, found


@pytest.mark.slow
def test_cmake_builds_and_tests_it(compiled, tmp_path) -> None:
    needs("cmake", "gcc")
    for switch in ("OFF", "ON"):
        build = tmp_path / switch
        run("cmake", "-S", compiled.folder("head-bc"), "-B", build, f"-DSF_FLOAT={switch}", cwd=tmp_path)
        run("cmake", "--build", build, cwd=tmp_path)
        assert "100% tests passed" in run("ctest", "--test-dir", build, cwd=tmp_path)


@pytest.mark.parametrize("target", list(TARGETS))
def test_the_same_model_gives_the_same_bytes(tmp_path, target) -> None:
    model = fitted(preset("table-bc"))
    write_model(model, tmp_path / "model.json")
    first = codegen(model, tmp_path / "first", target=target)
    second = codegen(tmp_path / "model.json", tmp_path / "second", target=target)
    assert first and [p.name for p in first] == [p.name for p in second]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
        text = one.read_text()
        assert text.endswith("\n") and not re.search(r"\b20[2-9]\d-\d\d-\d\d\b|/(tmp|home)/", text)
        assert model.machine.name in text or target == "c" or one.suffix in (".hal", ".c")


# ---- wrapper and library


def test_a_library_of_another_model_is_not_loaded(tmp_path) -> None:
    """Regenerated in the same folder: the library beside the wrapper is compiled anew, one that is named is refused."""
    needs("gcc")
    old, new = fitted(preset("table-bc")), fitted(preset("table-bc"), seed=1)
    codegen(old, tmp_path / "c")
    run(sys.executable, "-c", "import sf; sf.Machine(); sf.Batch()", cwd=tmp_path / "c")
    libraries = list((tmp_path / "c").glob("lib*.so"))
    stale = {path: Path(shutil.copy(path, tmp_path)) for path in libraries}
    codegen(new, tmp_path / "c", overwrite=True)
    module = loaded(tmp_path / "c" / "sf.py")
    for kind in (module.Machine, module.Batch):
        (one,) = (path for path in stale.values() if ("batch" in path.name) == (kind is module.Batch))
        with pytest.raises(module.WrongLibrary, match="another model"):
            kind(one)
    machine, batch = module.Machine(), module.Batch()
    for path, one in stale.items():
        assert module.MODEL.encode() in path.read_bytes() != one.read_bytes()
    q = np.array([10.0, 20.0, 0.3, 0.4, 30.0])
    p = np.array([new.values[name] for name in module.PARAMETERS])
    wanted = np.asarray(subject_of("table-bc").function()(q, TOOL, p)[0], dtype=float)[:, 0]
    assert machine.forward(q, TOOL)[0] == pytest.approx(wanted, abs=1e-9)
    assert batch.forward(q[None], TOOL, p)[0] == pytest.approx(wanted, abs=1e-9)


def test_a_library_that_others_could_have_written_is_not_loaded(compiled, tmp_path, monkeypatch) -> None:
    needs("gcc")
    module = loaded(compiled.folder("three-axis") / "sf.py")
    library = module.build(tmp_path, compiler="gcc", flags=("-O0",))
    module.Machine(library)
    for mode in (0o775, 0o757):
        library.chmod(mode)
        with pytest.raises(module.WrongLibrary, match="others can write"):
            module.Machine(library)
    library.chmod(0o755)
    owner = library.stat().st_uid
    if owner:
        monkeypatch.setattr(module.os, "getuid", lambda: owner + 1)
    else:
        os.chown(library, 12345, 0)
    with pytest.raises(module.WrongLibrary, match="another user"):
        module.Machine(library)
