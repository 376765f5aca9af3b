"""Search for drives, with a goal whose evidence is known beforehand."""

import math
from functools import partial
from types import SimpleNamespace

import pytest

from harness.config import resolve_single
from harness.experiment.design import design
from harness.experiment.kept_drives import KeptDrives
from harness.experiment.limits import Limits
from harness.experiment.manoeuvres import SearchRange, chosen

CAR = {"vehicle": "car", "parameters": "blanco_2021", "tyre": "linear", "sensors": "car_series"}
SHORTEST = 20.0


class Seconds:
    """A goal that is reached by seconds of driving, twice as fast by a sweep."""

    turns, surrogate = 2, None

    def __init__(self, needed):
        self.enough = -needed

    def evidence(self, drive):
        return ((2.0 if drive.drive.kind == "sine_sweep" else 1.0) * drive.seconds,)

    def value(self, evidence):
        return 0.0 if evidence is None else -float(evidence[0])

    preference = value


class Promised(Seconds):
    """The same with a surrogate that promises half as much again."""

    def __init__(self, needed, most=(math.inf, math.inf)):
        super().__init__(needed)
        self.sought, self.judged, self.most = 0, 0, most

    def evidence(self, drive):
        self.judged += 1
        return self.uninterrupted(drive, 1.0)

    def surrogate(self, drive):
        self.sought += 1
        return self.uninterrupted(drive, 1.5)

    def uninterrupted(self, drive, promised):
        if self.sought > self.most[0] or self.judged > self.most[1]:
            raise KeyboardInterrupt
        return (promised * super().evidence(drive)[0],)


def plan(goal, *manoeuvres, kept=None):
    room = SearchRange.of(resolve_single(CAR, "test"), Limits(), SHORTEST)
    rehearsal = SimpleNamespace()
    rehearsal.of = rehearsal.again = lambda drive: SimpleNamespace(drive=drive, seconds=drive.options["duration"])
    return design(goal, rehearsal, room, chosen(manoeuvres), 60.0, effort=4, jobs=1, kept=kept)


@pytest.mark.parametrize(("needed", "seconds"), [(70.0, 40.0), (100.0, 60.0), (math.inf, 60.0)])
def test_a_drive_is_as_short_as_settles_all(needed, seconds):
    (tried, times), *further = plan(Seconds(needed), "sweep").sequence
    assert (tried.seconds, times, further) == (seconds, 2, [])


def test_what_settles_as_soon_with_more_is_first():
    ranked = plan(Seconds(30.0), "step", "sweep").ranked
    assert [t.manoeuvre.name for t in ranked] == ["sweep", "step"]
    assert [t.seconds for t in ranked] == [40.0, 40.0]


@pytest.mark.parametrize(("needed", "seconds"), [(70.0, 40.0), (100.0, 60.0), (math.inf, 60.0)])
def test_drives_are_sought_by_a_surrogate_and_judged_in_full(needed, seconds):
    """At 100 it takes the shortest drive for enough, which the evidence does not."""
    goal = Promised(needed)
    made = plan(goal, "sweep", "step")
    (tried, times), *further = made.sequence
    assert (tried.manoeuvre.name, tried.seconds, times, further) == ("sweep", seconds, 2, [])
    assert made.value == pytest.approx(-2.0 * seconds)
    assert goal.judged <= 4 < made.tried


def test_interrupted_it_goes_on_from_what_was_sought_and_what_was_judged(tmp_path):
    whole, kept = Promised(100.0), partial(KeptDrives, tmp_path, "of this design")
    undisturbed = plan(whole, "sweep", "step")
    for most in ((3, math.inf), (math.inf, 1)):
        with pytest.raises(KeyboardInterrupt):
            plan(Promised(100.0, most), "sweep", "step", kept=kept())
    rest = Promised(100.0)
    again = plan(rest, "sweep", "step", kept=kept())
    assert (rest.sought, rest.judged) == (0, whole.judged - 1)
    assert (again.value, again.evidence) == (undisturbed.value, undisturbed.evidence)
    assert [t.seconds for t in again.ranked] == [t.seconds for t in undisturbed.ranked]
