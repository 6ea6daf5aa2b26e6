"""W. Wang & J. Li 2016: cross grid and double ball bar on a tilting table on a cross table, done anew.

`python -m examples.wang_li_2016 -o RESULTS`. The paper's equations stand in `equations` and are held against symfive's exact
chain; readings come from an independent plant (`tests/plant`).
"""
