"""The packages of symfive from the ground up, and what their files say about who imports whom."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LAYERS: dict[str, tuple[str, ...]] = {
    "ground": (
        "version", "errors", "numbers", "parameters", "screen", "threads", "executors", "compiled", "outputs", "disk", "files",
        "separated", "toml_files", "validation",
    ),
    "plain data": ("machine", "runs"),
    "one row of the model": ("kinematics", "motion", "row", "instruments", "effects"),
    "campaigns": ("campaign", "plausible", "circles", "convert", "procedures", "importers"),
    "model": ("model", "given", "check", "simulate"),
    "verbs": ("inference", "identify", "nc", "drawing", "design", "codegen", "standards", "worth", "diagnose", "posterior"),
    "results": ("report", "results", "fleet", "symfive", "cli"),
}  # fmt: skip
"""A package imports those of lower layers and those that stand before it in its own; `symfive` is the package's face."""


@dataclass(frozen=True)
class Import:
    """One imported `name` (None: the module itself) of the module `of` in the module `by`, at a line."""

    by: str
    of: str
    name: str | None
    line: int
    typing: bool
    """Whether it stands below `if TYPE_CHECKING`: for the reader and mypy, never executed."""

    def __str__(self) -> str:
        return f"{self.by} (line {self.line}) imports {self.of}{'' if self.name is None else ' ' + self.name}"


def modules() -> dict[str, Path]:
    """The files of the package by the name of their module."""
    names = {path: path.relative_to(ROOT).with_suffix("").parts for path in (ROOT / "symfive").rglob("*.py")}
    return {".".join(parts).removesuffix(".__init__"): path for path, parts in names.items()}


def package(module: str) -> str:
    """The package a module belongs to: `symfive.design._plan` → `design`, `symfive._api` → `symfive`."""
    parts = module.split(".")
    if parts[1:] == ["__main__"]:
        return "cli"
    return "symfive" if len(parts) == 1 or parts[1].startswith("_") else parts[1]


def imports() -> Iterator[Import]:
    """Every import of symfive within itself, wherever it stands in a file."""
    known = modules()
    for by, path in known.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        typing = {id(n) for top in ast.walk(tree) if _is_typing(top) for n in ast.walk(top)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                found = [(alias.name, None) for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                whole = [(f"{node.module}.{alias.name}", alias.name) for alias in node.names]
                found = [(full, None) if full in known else (node.module, name) for full, name in whole]
            else:
                continue
            yield from (
                Import(by, of, name, node.lineno, id(node) in typing)
                for of, name in found
                if of.split(".")[0] == "symfive"
            )


def _is_typing(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
