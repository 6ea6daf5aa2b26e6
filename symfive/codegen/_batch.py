"""The batch kernel: a slice of the graph over whole vectors of poses, what the parameters alone decide computed once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from symfive.codegen._sources import Sources, filled
from symfive.compiled.vector import HELPERS, LANES, Rows, indented, plain_lines

BLOCK = 4
L2_BYTES = 96_000
VECTOR_BYTES = 64


@dataclass(frozen=True)
class Batch:
    """Header and source of the batch functions of one subject (double precision, GCC or Clang)."""

    sources: Sources

    @cached_property
    def rows(self) -> Rows:
        """The point, then the Jacobian's column k, component i, over rows of q."""
        outputs = self.sources.graph.outputs
        targets = [(f"position[{i}] = %s;", node) for i, node in enumerate(outputs["position"])]
        targets += [(f"PUT({j // 3}U, {j % 3}U, %s);", node) for j, node in enumerate(outputs["position_by_p"])]
        return Rows(self.sources.graph, ("q",), targets)

    @property
    def constants(self) -> dict[int, int]:
        """Nodes that do not depend on q but are needed by what does, and their places in the array c."""
        return self.rows.constants

    @property
    def operations(self) -> int:
        """Operations a pose of point and Jacobian, without what is done once."""
        return self.rows.operations

    @property
    def tiles(self) -> int:
        """Vectors of poses that the information matrix takes at a time, so that they stay in the second-level cache."""
        return max(1, min(16, L2_BYTES // (3 * VECTOR_BYTES * self.columns)))

    @property
    def columns(self) -> int:
        """Columns of the Jacobian and the residual, filled up to whole blocks."""
        return -(-(self.sources.parameters + 1) // BLOCK) * BLOCK

    @property
    def names(self) -> dict[str, object]:
        """What the templates of the batch kernel and the loader may use."""
        blocks = (self.columns // BLOCK) * (self.columns // BLOCK + 1) // 2
        vectors = self.columns * 3 * self.tiles + blocks * BLOCK * BLOCK
        return {**self.sources.names, "constants": max(1, len(self.constants)), "columns": self.columns,
                "chunk": self.tiles, "vectors": vectors, "operations": self.operations}  # fmt: skip

    def header(self) -> str:
        """The header of the batch functions."""
        chosen = LANES.replace("LANES", f"{self.sources.prefix.upper()}_LANES")
        return filled("batch.h", lanes=chosen, **self.names)

    def source(self) -> str:
        """The source of the batch functions."""
        prepare = self.rows.prepare()
        lines = plain_lines(prepare)
        lines += [f"(void){name};" for name in ("tool", "p") if name not in prepare.reads]
        lines += [] if self.constants else ["c[0] = 0.0;"]
        points = self.rows.statements(self.rows.targets[:3])
        every = self.rows.statements(self.rows.targets)
        return filled(
            "batch.c",
            helpers=HELPERS,
            lanes=LANES,
            prepare=indented(lines),
            point_body=indented(points),
            jacobian_body=indented(every),
            **self.names,
        )
