"""`go.py`, the start from a fresh clone: what its processes are given."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parent.parent / "go.py"


@pytest.fixture
def go(monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # of the script itself
    spec = importlib.util.spec_from_file_location("go", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "PYTHON", Path(sys.executable))
    return module


def test_packages_installed_without_byte_code_are_compiled_once(go, monkeypatch, tmp_path):
    """Images of containers often set the variable; every process then compiled all it imports."""
    (tmp_path / "package.py").write_text("")
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.delenv("PYTHONPYCACHEPREFIX", raising=False)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    assert go.run("-c", "import package") == 0
    assert list((tmp_path / "__pycache__").glob("package.*.pyc"))


def test_one_thread_for_blas_unless_the_user_says_otherwise(go, monkeypatch):
    given = {}
    monkeypatch.setattr(subprocess, "call", lambda words, cwd, env: given.update(env) or 0)
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert go.run("-c", "") == 0
    assert (given["OPENBLAS_NUM_THREADS"], given["OMP_NUM_THREADS"]) == ("1", "3")
