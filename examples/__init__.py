"""Stories to run; what stands for the real machine in them is the independent plant of the tests."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
