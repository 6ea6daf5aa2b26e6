"""`python -m examples.tsutsumi_2007`."""

import sys

from .story import main

if __name__ == "__main__":
    sys.exit(main())
