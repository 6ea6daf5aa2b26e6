"""The command line under the package's own name; it lives in `symfive_cli`, which loads the package only when needed."""

from symfive_cli import app, main

__all__ = ["app", "main"]
