"""LinuxCNC's interpreter of programs, where it is installed."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

INSTALLED = shutil.which("rs274") is not None
needed = pytest.mark.skipif(not INSTALLED, reason="LinuxCNC's interpreter rs274 is not installed (linuxcnc-uspace)")


def canonical(path: Path) -> str:
    """What it makes of a program, which it takes."""
    answer = subprocess.run(
        ["rs274", "-g", str(path)], capture_output=True, text=True, timeout=60, cwd=path.parent, check=False
    )
    assert answer.returncode == 0, answer.stdout[-500:] + answer.stderr[-500:]
    return answer.stdout


def straight_moves(path: Path) -> np.ndarray:
    """Their end points, X Y Z A B C."""
    found = re.findall(r"STRAIGHT_(?:FEED|TRAVERSE)\(([^)]*)\)", canonical(path))
    return np.array([[float(v) for v in line.split(",")[:6]] for line in found])
