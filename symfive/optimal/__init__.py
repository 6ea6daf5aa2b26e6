"""The mathematics of optimal experiments: which rows of a list to read, and how far any choice of them is from the best.

A row is what one pose tells: sensitivities of its readings, per prior 1σ and over the noise (`Kernel`, `Candidates`). A `Task`
is a `Criterion` of some parameters with what is known before; set-up errors are marginalised. `choose` and `exchange`
find designs of whole poses, `refine` moves their poses, `relax` bounds them all. No machine, no instrument, no workspace.
"""

from symfive.optimal._cells import TINY, Cells, Cut, FirstCells, first_cells
from symfive.optimal._criteria import CRITERIA, Criterion, Trace, Volume, Worst, criterion_of, name_of
from symfive.optimal._exchange import Candidates, exchange, exchanged_options
from symfive.optimal._information import Layout, Task, inverse, marginal
from symfive.optimal._kernel import Kernel
from symfive.optimal._marginal import Marginal, marginal_sensitivity
from symfive.optimal._refine import Objective, Rows, refine
from symfive.optimal._relaxed import Relaxed, apportioned, choose, relax, sensitivity
from symfive.optimal._spectrum import spectrum_of

__all__ = [
    "CRITERIA", "TINY", "Candidates", "Cells", "Criterion", "Cut", "FirstCells", "Kernel", "Layout", "Marginal", "Objective",
    "Relaxed", "Rows", "Task", "Trace", "Volume", "Worst", "apportioned", "choose", "criterion_of", "exchange",
    "exchanged_options", "first_cells", "inverse", "marginal", "marginal_sensitivity", "name_of", "refine", "relax",
    "sensitivity", "spectrum_of",
]  # fmt: skip
