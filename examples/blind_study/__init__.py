"""The blind study: sealed campaigns of an independent plant, diagnosed by symfive, opened and scored.

`python -m examples.blind_study --cases N --seed S -o DIR`. What makes the cases (`plans`, `effects`, `span`, `cases`)
knows the plant only and nothing of symfive; what judges them (`judge`) never sees an answer.
"""
