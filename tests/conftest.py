"""Nothing here compiles for the user's cache: `SYMFIVE_COMPILER=cc` in the environment lets every test do so."""

import os

os.environ.setdefault("SYMFIVE_COMPILER", "none")
