"""One way: a package imports by public names what stands below it in `docs/_architecture.py`; no circle of modules at all."""

from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from _architecture import LAYERS, Import, imports, modules, package, picture

ROOT = Path(__file__).resolve().parent.parent

ORDER = [name for layer in LAYERS.values() for name in layer]


@pytest.fixture(scope="module")
def every() -> list[Import]:
    return list(imports())


@pytest.fixture(scope="module")
def across(every: list[Import]) -> list[Import]:
    return [i for i in every if package(i.by) != package(i.of)]


def test_the_table_has_every_package_once():
    assert sorted(ORDER) == sorted({package(module) for module in modules()})


def test_a_package_imports_only_what_stands_below_it(across):
    place = {name: number for number, name in enumerate(ORDER)}
    assert not [str(i) for i in across if place[package(i.of)] >= place[package(i.by)]]


def test_no_private_name_crosses_a_package(across):
    def private(name: str) -> bool:
        return name.startswith("_") and name != "__version__"

    assert not [str(i) for i in across if any(map(private, (*i.of.split("."), i.name or "")))]


def test_no_modules_import_one_another(every):
    """Imports for types and those within functions count too."""
    needs: dict[str, set[str]] = {}
    for i in every:
        if i.by != i.of:
            needs.setdefault(i.by, set()).add(i.of)
    list(TopologicalSorter(needs).static_order())  # raises CycleError, which names the circle


def test_the_picture_shows_the_table():
    drawn = (ROOT / "docs" / "architecture.svg").read_text(encoding="utf-8")
    assert drawn == picture(), "run: python docs/_architecture.py"
