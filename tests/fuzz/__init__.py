"""Coverage-guided fuzzing of every reader, and the inputs that it left behind: `python -m tests.fuzz --help`."""
