"""The packages of symfive from the ground up, and their imports. `python docs/_architecture.py` draws `architecture.svg`."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LAYERS: dict[str, tuple[str, ...]] = {
    "ground": (
        "version", "errors", "arrays", "numbers", "parameters", "screen", "threads", "executors", "compiled", "outputs", "disk",
        "files", "separated", "toml_files", "validation",
    ),
    "plain data": ("machine", "runs"),
    "physics": ("kinematics", "motion", "row", "instruments", "effects"),
    "campaigns": ("campaign", "plausible", "circles", "convert", "procedures", "importers", "toolpath"),
    "model": ("model", "given", "check", "simulate"),
    "verbs": (
        "inference", "identify", "nc", "drawing", "moves", "optimal", "design", "codegen", "standards", "worth", "posterior",
        "diagnose",
    ),
    "results": ("report", "results", "fleet", "history", "symfive", "cli"),
}  # fmt: skip
"""A package imports those of lower layers and those that stand before it in its own; `symfive` is the package's face."""


@dataclass(frozen=True)
class Import:
    """One imported `name` (None: the module itself) of the module `of` in the module `by`, at a line."""

    by: str
    of: str
    name: str | None
    line: int

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
    """Every import of symfive within itself, wherever it stands in a file: for types and within functions too."""
    known = modules()
    for by, path in known.items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found = [(alias.name, None) for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module:
                whole = [(f"{node.module}.{alias.name}", alias.name) for alias in node.names]
                found = [(full, None) if full in known else (node.module, name) for full, name in whole]
            else:
                continue
            yield from (Import(by, of, name, node.lineno) for of, name in found if of.split(".")[0] == "symfive")


WIDTH, LABEL, BOX, GAP = 860, 190, 30, 8


def picture() -> str:
    """The layers as bands, the ground at the bottom, a box a package: SVG."""
    rows = {layer: list(_lines(names)) for layer, names in LAYERS.items()}
    heights = {layer: len(lines) * (BOX + GAP) + GAP for layer, lines in rows.items()}
    total = sum(heights.values()) + GAP * (len(rows) + 1)
    parts, y = [], GAP
    for layer in reversed(LAYERS):
        parts.append(f'<rect x="30" y="{y}" width="{WIDTH - 40}" height="{heights[layer]}" rx="6" fill="#f2f4f7"/>')
        parts.append(f'<text x="42" y="{y + heights[layer] / 2 + 5:g}" font-weight="bold">{layer}</text>')
        for number, line in enumerate(rows[layer]):
            x, top = LABEL, y + GAP + number * (BOX + GAP)
            for name in line:
                wide = _wide(name)
                parts.append(
                    f'<rect x="{x}" y="{top}" width="{wide}" height="{BOX}" rx="4" fill="#fff" stroke="#8a94a6"/>'
                )
                parts.append(f'<text x="{x + wide / 2:g}" y="{top + 20}" text-anchor="middle">{name}</text>')
                x += wide + GAP
        y += heights[layer] + GAP
    arrow = (
        f'<path d="M15 {GAP} V{total - 18}" stroke="#444" stroke-width="2"/>'
        f'<path d="M9 {total - 20} h12 l-6 12 z" fill="#444"/>'
        f'<text transform="translate(11 {total / 2}) rotate(-90)" text-anchor="middle" font-size="12">imports</text>'
    )
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {total}" width="{WIDTH}" height="{total}" '
        'font-family="sans-serif" font-size="13" fill="#1d2430">'
    )
    paper = f'<rect width="{WIDTH}" height="{total}" fill="#fff"/>'
    return "\n".join([head, "<title>The packages of symfive in layers</title>", paper, arrow, *parts, "</svg>"]) + "\n"


def _wide(name: str) -> int:
    return 20 + 8 * len(name)


def _lines(names: tuple[str, ...]) -> Iterator[list[str]]:
    """The packages of a layer, as many on a line as fit."""
    line: list[str] = []
    for name in names:
        if LABEL + sum(_wide(other) + GAP for other in [*line, name]) > WIDTH - 18:
            yield line
            line = []
        line.append(name)
    yield line


if __name__ == "__main__":
    (ROOT / "docs" / "architecture.svg").write_text(picture(), encoding="utf-8")
