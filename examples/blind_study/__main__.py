"""`python -m examples.blind_study`."""

import sys

from symfive.errors import InputError

from .study import main

if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"blind study: {error}")
