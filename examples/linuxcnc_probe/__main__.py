"""`python -m examples.linuxcnc_probe`."""

import sys

from .loop import main

if __name__ == "__main__":
    sys.exit(main())
