"""`python -m symfive_cli`."""

from symfive_cli import main

main()
