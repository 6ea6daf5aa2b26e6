"""The lock: every dependency of every extra, each with hashes; what go.py installs for an extra is complete."""

import importlib.util
import re
import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SPEC = importlib.util.spec_from_file_location("go", ROOT / "go.py")
assert SPEC is not None and SPEC.loader is not None
go = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(go)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def entries(text: str) -> dict[str, str]:
    found = re.findall(r"^([\w.-]+)==(.*?)(?=^[\w.-]+==|\Z)", text, re.M | re.S)
    return {go.plain_name(name): rest for name, rest in found}


def test_every_package_has_a_version_and_hashes():
    packages = entries(go.LOCK.read_text())
    assert len(packages) > 60
    for name, rest in packages.items():
        assert re.match(r"\d[\w.]*( ;.*?)? \\\n", rest), name
        assert len(re.findall(r"--hash=sha256:[0-9a-f]{64}", rest)) >= 1, name
    assert len(re.findall("--hash", packages["numpy"])) > 30  # a wheel for every platform and Python


@pytest.mark.parametrize("extra", ["", *go.EXTRAS])
def test_what_an_extra_needs_is_locked_with_all_that_it_needs(extra):
    packages = entries(go.locked(*([extra] if extra else [])))
    assert {go.plain_name(d) for d in PROJECT["dependencies"]} <= set(packages)
    for name in packages:
        try:
            needs = distribution(name).requires or []
        except PackageNotFoundError:
            continue  # of an extra that is not installed here
        for need in (n for n in needs if ";" not in n):
            assert go.plain_name(need) in packages, f"{name} needs {need}"
    others = {e: {go.plain_name(d) for d in PROJECT["optional-dependencies"][e]} for e in go.EXTRAS if e != extra}
    assert not (others["sbom"] | others["docs"] if extra == "test" else set()) & set(packages)


def test_a_dependency_that_is_not_locked_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(go, "LOCK", tmp_path / "constraints.txt")
    (tmp_path / "constraints.txt").write_text("numpy==2.0.0 \\\n    --hash=sha256:00\n")
    with pytest.raises(SystemExit, match=r"lacks casadi.*go.py lock"):
        go.locked()
