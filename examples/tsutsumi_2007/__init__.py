"""M. Tsutsumi, D. Yumiza, K. Utsumi & R. Sato 2007: the synchronous circle of X and C, done anew.

`python -m examples.tsutsumi_2007 -o RESULTS`. The paper's path, drives and readings stand in `path`, `drives` and
`readings`, in numpy and without symfive; `twin` holds symfive's model against them.
"""
