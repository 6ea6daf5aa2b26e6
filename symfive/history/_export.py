"""The whole history as one long table, for DuckDB, pandas or a spreadsheet: a row an error and visit."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from symfive.errors import InputError
from symfive.history._visit import Visit
from symfive.separated import plain_cell

COLUMNS = (
    "machine", "serial", "structure", "key", "when", "stage", "instrument", "operator", "temperature_C", "note", "version",
    "results", "manifest", "folder", "name", "value", "std", "prior", "unit", "rms", "rms_unit", "chi2_dof", "converged",
    "findings",
)  # fmt: skip
FORMATS = (".csv", ".parquet")
BATCH = 50_000
"""Rows of a Parquet row group."""


def format_of(path: Path) -> str:
    """Which of `FORMATS` the name of a file asks for. Raises `InputError`."""
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        problem = f'the table cannot be written as "{suffix or path.name}"'
        raise InputError(problem, path=path, remedy=f"end its name with {' or '.join(FORMATS)}")
    return suffix


def write_table(visits: Iterable[tuple[Path, Visit]], path: Path, *, suffix: str) -> int:
    """Write the table to `path` as `suffix` says; the number of its rows. Raises `InputError` without pyarrow for Parquet."""
    rows = (row for folder, visit in visits for row in _rows(folder, visit))
    return _csv(rows, path) if suffix == ".csv" else _parquet(rows, path)


def _rows(folder: Path, visit: Visit) -> Iterator[tuple[Any, ...]]:
    findings = "; ".join(finding.words for finding in visit.findings)
    machine = (visit.machine.name, visit.machine.serial, visit.machine.structure, visit.machine.key)
    details = (visit.when, visit.stage, visit.instrument, visit.operator, visit.temperature, visit.note)
    origin = (visit.version, visit.results, visit.manifest, str(folder))
    after = (visit.rms, visit.rms_unit, visit.chi2_dof, visit.converged, findings)
    for name, value, std, prior, unit in zip(
        visit.names, visit.values, visit.std, visit.priors, visit.units, strict=True
    ):
        yield (*machine, *details, *origin, name, float(value), float(std), float(prior), unit, *after)


def _csv(rows: Iterable[tuple[Any, ...]], path: Path) -> int:
    count = 0
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(COLUMNS)
        for row in rows:
            table.writerow([plain_cell(cell) for cell in row])
            count += 1
    return count


def _parquet(rows: Iterable[tuple[Any, ...]], path: Path) -> int:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        problem = "Parquet needs the package pyarrow"
        raise InputError(problem, remedy="install symfive[history], or write a .csv") from None
    kinds = {"temperature_C": pa.float64(), "value": pa.float64(), "std": pa.float64(), "prior": pa.float64(),
             "rms": pa.float64(), "chi2_dof": pa.float64(), "converged": pa.bool_()}  # fmt: skip
    schema = pa.schema([(name, kinds.get(name, pa.string())) for name in COLUMNS])
    count = 0
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        left = iter(rows)
        while batch := list(islice(left, BATCH)):
            columns = [pa.array(column, schema.field(i).type) for i, column in enumerate(zip(*batch, strict=True))]
            writer.write_table(pa.table(columns, schema=schema))
            count += len(batch)
    return count
