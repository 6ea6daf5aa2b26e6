"""Target `c`: C99 sources with header, self-test, batch kernel, CMake file, Python loader and a page of the interface."""

from __future__ import annotations

from symfive.codegen._batch import Batch
from symfive.codegen._page import loader, page
from symfive.codegen._selftest import selftest
from symfive.codegen._sources import Sources, filled
from symfive.codegen._subject import Subject


def c_files(subject: Subject, prefix: str) -> dict[str, str]:
    """File names and their text."""
    sources = Sources(subject, prefix)
    batch = Batch(sources)
    return {
        f"{prefix}.h": sources.header(),
        f"{prefix}.c": sources.source(),
        f"{prefix}_batch.h": batch.header(),
        f"{prefix}_batch.c": batch.source(),
        f"{prefix}_selftest.c": selftest(sources),
        "CMakeLists.txt": filled("CMakeLists.txt", **sources.names),
        f"{prefix}.py": loader(sources, batch),
        f"{prefix}.html": page(sources),
    }
