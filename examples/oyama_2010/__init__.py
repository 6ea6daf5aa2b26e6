"""C. Oyama, S. Ibaraki & A. Otsubo 2010: the error map of a tilting rotary table by R-test, done anew.

`python -m examples.oyama_2010 -o RESULTS`. The recordings come from an independent plant (`tests/plant`); the paper's
equations stand in `equations` and are held against symfive's exact chain.
"""

import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[2] / "tests"
if str(TESTS) not in sys.path:
    sys.path.insert(0, str(TESTS))  # the plant lives there
