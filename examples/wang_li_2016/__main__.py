"""`python -m examples.wang_li_2016`."""

import sys

from .story import main

if __name__ == "__main__":
    sys.exit(main())
