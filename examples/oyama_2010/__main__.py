"""`python -m examples.oyama_2010`."""

import sys

from .story import main

if __name__ == "__main__":
    sys.exit(main())
