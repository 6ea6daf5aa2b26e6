"""Symbolic functions over many rows: interpreted at first, compiled once that is cheaper, with the same bits either way.

    rows = Mapped(function, held=(1,))     # a CasADi function; its second input is the same for all rows
    (result,) = rows(inputs, parameters)   # (n, elements)
    print(status())                        # which compiler, where its libraries lie, how many functions use it

The environment variable `SYMFIVE_COMPILER` names the C compiler (by default the first of cc, gcc and clang); `none` switches
compiling off. Without a compiler everything stays interpreted.
"""

from symfive.compiled._mapped import Mapped, Status, status
from symfive.compiled._oracle import Oracle

__all__ = ["Mapped", "Oracle", "Status", "status"]
