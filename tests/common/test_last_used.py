"""What was used last stays, and what was not used for longest goes."""

from harness.common.cache import LastUsed


def test_the_last_used_stay_and_all_that_are_kept_at_once_do():
    kept = LastUsed[int](2)
    kept.keep(["a", "b"], [1, 2])
    kept.keep(["a"], [1])  # used again
    kept.keep(["c"], [3])
    assert kept.get(["a", "b", "c"]) == [1, None, 3]
    kept.keep("defg", [4, 5, 6, 7])
    assert kept.get("cdefg") == [None, 4, 5, 6, 7]
    assert len(kept) == 4
    kept.keep("h", [8])
    assert kept.get("fgh") == [None, 7, 8]
