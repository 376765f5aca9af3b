"""Runs that foreign code lost are counted by reason."""

from harness.external.losses import Losses


def test_reasons_that_differ_by_numbers_are_one_line():
    losses = Losses("truck.fmu")
    for reason in ("error at t = 1.25 s", "SIGSEGV", "error at t = 3 s", "error at t = 3 s", "error at t = 1e-05 s"):
        losses.add(reason)
    assert losses.taken() == [
        "truck.fmu: 4 runs lost: error at t = 3 s (others with other numbers)",
        "truck.fmu: 1 run lost: SIGSEGV",
    ]
    assert losses.taken() == []
