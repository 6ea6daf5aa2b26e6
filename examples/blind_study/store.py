"""The study's folder: what is finished stays finished, whatever kills the run; answers are sealed by SHA-256."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Store:
    """`cases/ID/{fit,heldout}` recordings, `answers/ID.json`, `seals/ID.json`, and one folder a stage of results."""

    root: Path

    def case(self, id: str) -> Path:
        """Folder of the recordings."""
        return self.root / "cases" / id

    def has(self, stage: str, id: str) -> bool:
        """Whether a stage is finished for a case."""
        return self._file(stage, id).is_file()

    def put(self, stage: str, id: str, data: Any) -> None:
        """Result of a stage, written at once or not at all."""
        self._write(self._file(stage, id), json.dumps(data, default=float))

    def get(self, stage: str, id: str) -> Any:
        """Result of a stage."""
        return json.loads(self._file(stage, id).read_text())

    def seal(self, id: str, answer: str) -> None:
        """Keeps an answer and the digest of it and of the recordings."""
        self._write(self._file("answers", id), answer)
        self.put("seals", id, {"answer": digest(answer.encode()), "recordings": self._recordings(id)})

    def open(self, id: str) -> Any:
        """The answer, once its case has a verdict; ValueError where answer or recordings are not those sealed."""
        if not self.has("verdicts", id):
            raise ValueError(f"{id} has no verdict yet: its answer stays sealed")
        text, seal = self._file("answers", id).read_text(), self.get("seals", id)
        if digest(text.encode()) != seal["answer"]:
            raise ValueError(f"{id}: the answer is not the one that was sealed")
        if self._recordings(id) != seal["recordings"]:
            raise ValueError(f"{id}: the recordings are not those that were sealed")
        return json.loads(text)

    def _recordings(self, id: str) -> str:
        files = sorted(p for p in self.case(id).rglob("*") if p.is_file())
        return digest(
            b"\0".join(p.relative_to(self.case(id)).as_posix().encode() + b"\0" + p.read_bytes() for p in files)
        )

    def _file(self, stage: str, id: str) -> Path:
        return self.root / stage / f"{id}.json"

    @staticmethod
    def _write(path: Path, text: str) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = path.with_suffix(f".{os.getpid()}")
        draft.write_text(text)
        draft.replace(path)


def digest(data: bytes) -> str:
    """SHA-256, hexadecimal."""
    return hashlib.sha256(data).hexdigest()
