"""The order of a search: rounds, what stays or takes its place, and rounds again where something took a place."""

from types import SimpleNamespace

import pytest

from harness.common.failures import RAISED
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.selection import forward_selection as search

LAG, GAIN, BANK, ROLL = (Hypothesis(n, "effect", (n,)) for n in ("lag", "gain", "bank", "roll"))
FIT = SimpleNamespace(point="point")


def rounds_that_add(passes, seen):
    """Return rounds that add what ``passes`` has for a model, and note the models that they began with."""

    def one_round(self, added, best, number):
        seen.append(added)
        h = passes.get(added)
        found = SimpleNamespace(hypothesis=h, fitted=FIT) if h else None
        return SimpleNamespace(best=FIT, without=[FIT]), [SimpleNamespace(added=found)]

    return one_round


def fits_of_all():
    """Return fits that are all the same, of models that leave something."""
    judged = SimpleNamespace(normalised_excess_mse=1.0)
    return SimpleNamespace(
        say=lambda _: None, fit=lambda *_: FIT, judge=lambda *_: judged, free=(), held_out=None,
        fitting=SimpleNamespace(first=lambda: None), refuted=set(), joined=lambda added, h: (*added, h),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("instead", "after", "final", "asked"),
    [
        ({(LAG,): (GAIN,)}, {(GAIN,): BANK}, (GAIN, BANK), [(), (LAG,), (GAIN,), (GAIN, BANK)]),
        ({(LAG,): ()}, {}, (), [(), (LAG,)]),  # a mere removal leaves nothing new to look for
        ({(LAG,): (GAIN,), (GAIN,): (LAG,)}, {}, (LAG,), [(), (LAG,), (GAIN,)]),
        (
            {(LAG,): (GAIN,), (GAIN, BANK): (LAG, BANK)}, {(GAIN,): BANK},
            (LAG, BANK), [(), (LAG,), (GAIN,), (GAIN, BANK), (LAG, BANK)],
        ),
        (  # a way that leads back to where it went on from ends there
            {(LAG,): (GAIN,), (GAIN, BANK): (ROLL,), (ROLL, BANK): (GAIN,)}, {(GAIN,): BANK, (ROLL,): BANK},
            (GAIN,), [(), (LAG,), (GAIN,), (GAIN, BANK), (ROLL,), (ROLL, BANK)],
        ),
    ],
)  # fmt: skip
def test_rounds_go_on_where_something_took_the_place_of_an_addition(monkeypatch, instead, after, final, asked):
    passes, seen = {(): LAG, **after}, []

    monkeypatch.setattr(search._ForwardSelection, "_round", rounds_that_add(passes, seen))
    monkeypatch.setattr(search, "likeliest", lambda _, __, added, best, turns: (instead.get(added, added), best, None))
    fits = fits_of_all()
    selection = search._ForwardSelection(fits, 8, RAISED)
    found = selection.completed(selection.first())
    assert found.added == final
    assert seen == asked
    assert set(found.dropped) == {h for r in found.rounds if r.added for h in [r.added.hypothesis]} - set(final)


@pytest.mark.parametrize(
    ("better", "final", "asked"),
    [
        ((GAIN, BANK), (GAIN, BANK), [(), (LAG,), (GAIN,), (GAIN, BANK)]),  # it led to more than the nominal model did
        ((LAG,), (LAG,), [(), (LAG,), (GAIN,), (GAIN, BANK)]),
        (None, (LAG,), [(), (LAG,)]),  # the likeliest of the earlier ones is where the search has been
    ],
)
def test_a_search_goes_on_from_the_likeliest_model_of_an_earlier_trace(monkeypatch, better, final, asked):
    passes, seen = {(): LAG, (GAIN,): BANK}, []

    known = [((ROLL,), FIT), ((GAIN,) if better else (LAG,), FIT)]
    likely = {(GAIN,), better, (LAG,)} if better != (LAG,) else {(GAIN,), (LAG,)}
    monkeypatch.setattr(search._ForwardSelection, "_round", rounds_that_add(passes, seen))
    monkeypatch.setattr(search, "likeliest", lambda fits, rounds, added, best, turns: (added, best, len(seen)))
    monkeypatch.setattr(search, "fit_earlier", lambda fits, earlier, nominal: known)

    def likeliest(models):
        return max((m for m in models if m[0] in likely), key=lambda m: (m[0] == better, m[0] == (GAIN,)))

    monkeypatch.setattr(search, "Comparison", lambda fits, rounds: SimpleNamespace(likeliest=likeliest))
    fits = fits_of_all()
    selection = search._ForwardSelection(fits, 8, RAISED)
    found = selection.completed(selection.first())
    assert (found.added, seen) == (final, asked)
    assert found.posterior == len(asked)  # of all that was fitted


def test_what_was_added_on_a_detour_takes_no_room_and_late_channels_take_one():
    late = [Hypothesis(f"sensor_delay@{n}", "effect", (f"late_{n}",)) for n in ("yaw_rate", "speed")]
    room = []

    def decided(left):
        room.append(left)
        return SimpleNamespace(added=None, hopeful=None)

    tried = SimpleNamespace(decided=decided, decided_by_sensor=decided)
    for added in ((), (LAG,), (*late, LAG), tuple(late)):
        tried.added = added
        search._ForwardSelection(None, 3, RAISED)._passed(tried, 7)
    assert room == [3, 3, 2, 2, 1, 1, 2, 2]


@pytest.mark.parametrize(
    ("likelihoods", "worse", "grows"),
    [
        ([10.0], False, [True]),
        ([10.0], True, [False]),  # simulates the held-out drives worse than the nominal model
        ([30.0, 10.0], False, [False, True]),  # what the plain search ends in is less likely than what it had so far
        ([30.0, 30.0], False, [False, False]),
    ],
)
def test_a_grown_model_has_to_beat_the_plain_one_and_the_nominal_one_and_grows_once(
    monkeypatch, likelihoods, worse, grows
):
    """The grown model has a log-likelihood of 20 on the held-out drives, the plain one what is listed."""
    rest = dict.fromkeys(("fitting", "held_out", "free", "nominal", "rounds", "dropped", "before"))
    plain = search.Trace(final=FIT, added=(LAG,), after=None, **rest | {"nominal": FIT})
    differing = search.Trace(final=FIT, added=(GAIN,), after=SimpleNamespace(log_likelihood=20.0), **rest)
    judged, starts = iter(likelihoods), []
    fits = SimpleNamespace(
        fit=lambda *_, **__: FIT, fitting=SimpleNamespace(standard_errors=lambda _: None),
        judge=lambda added, _: SimpleNamespace(log_likelihood=next(judged)) if added else None,
    )  # fmt: skip
    monkeypatch.setattr(search, "random_processes", lambda _: ())
    monkeypatch.setattr(search, "with_discrepancy", lambda *_: FIT)
    monkeypatch.setattr(search, "hinges", lambda *_: ("size",))
    monkeypatch.setattr(search, "error_growth", lambda *_: SimpleNamespace(beyond_noise=worse))
    monkeypatch.setattr(search._Growth, "_fits_with", lambda *_: fits)
    monkeypatch.setattr(search._Growth, "_grown", lambda _, start: starts.append(start) or differing)
    monkeypatch.setattr(search._Growth, "_hinging", lambda *_: ())
    growth = search._Growth(SimpleNamespace(augmented=None), 2, RAISED)
    answers = [growth.answer(plain, completed=bool(i)) for i in range(len(grows))]
    assert [a is not None and a.added == (GAIN,) for a in answers] == grows
    assert answers[0] is None or grows[0]  # a search that is not over goes on
    assert len(starts) == 1
    if len(grows) == 2 and not grows[1]:
        assert (answers[1].added, answers[1].hinging) == ((LAG,), ("size",))
