"""What a planned drive tells, for tests of what drives are planned for."""

import numpy as np

from harness.experiment.contract import Evidence, Goal
from harness.experiment.limits import Limits
from harness.experiment.manoeuvres import SearchRange, chosen
from harness.experiment.rehearsal import Rehearsal, Rehearsed


def evidence_of(goal: Goal, name: str, point: list[float], largest: float = 4.0, surrogate: bool = False) -> Evidence:
    """Return what a manoeuvre at a point of its unit cube tells, within a lateral acceleration in m/s^2."""
    drive = rehearsed(goal, name, point, largest)
    return goal.surrogate(drive) if surrogate else goal.evidence(drive)


def rehearsed(goal: Goal, name: str, point: list[float], largest: float = 4.0) -> Rehearsed:
    """Return a manoeuvre at a point of its unit cube, within a lateral acceleration in m/s^2."""
    limits, spec = Limits(lateral_acceleration=largest), goal.model.spec
    (manoeuvre,) = chosen([name])
    room = SearchRange.of(spec, limits, goal.shortest, goal.lead_in)
    rehearsal = Rehearsal(goal.model, spec, goal.versions, goal.recorded, limits)
    drive = rehearsal.of(manoeuvre.drive(np.array(point), room, name))
    assert not isinstance(drive, str), drive
    return drive
