"""`python -m symfive`."""

from symfive.cli import main

main()
