"""C. Oyama, S. Ibaraki & A. Otsubo 2010: the error map of a tilting rotary table by R-test, done anew.

`python -m examples.oyama_2010 -o RESULTS`. The recordings come from an independent plant (`tests/plant`); the paper's
equations stand in `equations` and are held against symfive's exact chain.
"""
