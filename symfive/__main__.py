"""`python -m symfive`."""

from symfive_cli import main

main()
