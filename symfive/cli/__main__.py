"""`python -m symfive.cli`."""

from symfive.cli import main

main()
