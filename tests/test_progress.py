"""The line that tells how far the tests are."""

from types import SimpleNamespace

from progress import EVERY_S, Progress


def test_a_line_every_half_minute_with_all_workers_tests_counted_once():
    said, clock = [], [0.0]
    progress = Progress(said.append, lambda: clock[0])
    for _worker in range(2):
        progress.pytest_xdist_node_collection_finished(ids=["a"] * 100)
    for number in range(40):
        clock[0] += 2.0
        for when in ("setup", "call", "teardown"):
            progress.pytest_runtest_logreport(SimpleNamespace(when=when, failed=when == "call" and number == 3))
    assert EVERY_S == 30.0
    assert said == [
        "14 of 100 tests done after 0 min 30 s, 1 failed",
        "29 of 100 tests done after 1 min 00 s, 1 failed",
    ]
