"""Recordings of real machines, and a model that has been deprived of their physics: what the diagnosis does with them.

`python -m examples.real_recordings -o RESULTS [--only NAME]`. The recordings are not part of symfive; they are read where
`SYMFIVE_DATA` says (docs/recordings.md), and those that are not there are left out with a sentence.
"""
