"""`python -m examples.linuxcnc_bar`."""

import sys

from .loop import main

if __name__ == "__main__":
    sys.exit(main())
