"""The campaign: ratios with intervals against closed forms, verdicts, and the findings on studies of known errors."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from harness.common.errors import UserError
from harness.common.statistics import Interval
from harness.config.specs import MonitorSpec
from harness.reporting import hooks
from harness.study import trust_file
from harness.study.report.analysis import Analysis
from harness.study.results import read
from reproductions.campaign import box, trust
from reproductions.campaign.answer import Joint, answer
from reproductions.campaign.claims import CLAIMS, findings
from reproductions.campaign.evidence import Evidence, Verdict, judge, ratio_of_medians, share
from reproductions.campaign.on_study import first_page_of_times
from reproductions.campaign.report import write_campaign
from reproductions.campaign.results import Results
from support.campaign_folder import EVERYONE, write_studies
from support.synthetic import design, write

FORCE = "lateral_force_axle_21"


@pytest.fixture
def campaign(tmp_path: Path):
    """Return a function that writes the studies, each level with the error and the losses one asks for."""

    def make(
        growth: dict[tuple[str, str, str], float] | None = None,
        lost: tuple[str, str, int] | None = None,
        further: dict[str, float] | None = None,
    ):
        write_studies(tmp_path, growth, lost, further)
        return Results(tmp_path)

    return make


def test_a_tuned_filter_beside_the_others_is_not_judged(campaign):
    growth = {("mass", "8 t", FORCE): 3.0, ("tyre", "±10 %", FORCE): 1.05}
    values = []
    for factor in (1.0, 0.2):
        found = findings(campaign(growth, further={"EKF, tuned": factor}))
        values.append([e.value for f in found for e in f.evidence])
    assert len(values[0]) > len(CLAIMS)
    assert values[0] == values[1]


def verdict_on(found, place: str) -> Verdict:
    """Return the verdict on the claim whose text begins so."""
    return next(f.verdict for f in found if f.claim.text.startswith(place))


def test_interval_of_a_ratio_holds_the_closed_form():
    """Medians of independent log-normal samples: their ratio is the exponential of a difference of normal medians."""
    rng = np.random.default_rng(0)
    held = 0
    for seed in range(60):
        above, below = np.exp(rng.normal(np.log(2.0), 0.4, (6, 1, 40))), np.exp(rng.normal(0.0, 0.4, (6, 1, 40)))
        (_, lower, upper), n = ratio_of_medians(above, below, seed=seed)
        held += lower <= 2.0 <= upper
        assert n == 240
    assert 51 <= held <= 60  # 57 expected; outside with a probability of 3 in 1000


def test_pairs_take_what_both_share_out_of_the_interval():
    rng = np.random.default_rng(1)
    common = np.exp(rng.normal(0.0, 1.0, (6, 1, 40)))
    above = 1.5 * common * np.exp(rng.normal(0.0, 0.01, common.shape))
    paired, _ = ratio_of_medians(above, common)
    torn_apart, _ = ratio_of_medians(above, rng.permuted(common, axis=2))
    assert paired.lower < 1.5 < paired.upper
    assert paired.upper - paired.lower < 0.1 * (torn_apart.upper - torn_apart.lower)


def test_a_pair_with_a_lost_run_counts_on_neither_side():
    above, below = np.full((1, 1, 4), 3.0), np.full((1, 1, 4), 1.0)
    above[0, 0, 0], below[0, 0, 1] = np.nan, np.nan
    below[0, 0, 0] = 100.0
    assert ratio_of_medians(above, below) == (Interval(3.0, 3.0, 3.0), 2)
    empty, n = ratio_of_medians(np.full((1, 1, 4), np.nan), below)
    assert n == 0
    assert np.isnan(empty.value)


def test_share_is_clopper_pearson():
    found = share(11, 60)
    assert found.lower == pytest.approx(stats.beta.ppf(0.025, 11, 50))
    assert found.upper == pytest.approx(stats.beta.ppf(0.975, 12, 49))
    assert share(0, 60).upper == pytest.approx(1 - 0.025 ** (1 / 60))


@pytest.mark.parametrize(
    ("interval", "verdict"),
    [
        ((1.1, 1.0, 1.2), Verdict.REPRODUCED),
        ((2.0, 1.6, 2.4), Verdict.NOT_REPRODUCED),
        ((1.4, 1.2, 1.6), Verdict.UNDECIDED),
        ((np.nan, np.nan, np.nan), Verdict.UNDECIDED),
    ],
)
def test_verdict_asks_for_the_whole_interval(interval, verdict):
    assert Evidence("", Interval(*interval), (0.9, 1.5), np.nan, 10).verdict is verdict


def test_one_number_against_a_claim_refutes_it_and_one_open_number_leaves_it_open():
    def evidence(lower, upper):
        return Evidence("", Interval((lower + upper) / 2, lower, upper), (0.0, 1.0), np.nan, 10)

    inside, across, outside = evidence(0.2, 0.8), evidence(0.8, 1.2), evidence(1.2, 1.4)
    assert judge([inside, inside]) is Verdict.REPRODUCED
    assert judge([inside, across]) is Verdict.UNDECIDED
    assert judge([inside, across, outside]) is Verdict.NOT_REPRODUCED
    assert judge([]) is Verdict.UNDECIDED


def test_findings_follow_the_errors(campaign):
    """All estimators alike and nothing matters: what says so is reproduced, what says otherwise is not."""
    found = findings(campaign())
    assert len(found) == len(CLAIMS)
    assert verdict_on(found, "EKF and UKF differ") is Verdict.REPRODUCED
    assert verdict_on(found, "The mass hardly") is Verdict.REPRODUCED
    assert verdict_on(found, "A trailer mass other") is Verdict.NOT_REPRODUCED
    assert verdict_on(found, "Ten-fold") is Verdict.NOT_REPRODUCED
    assert verdict_on(found, "Trailer tyres within") is Verdict.NOT_REPRODUCED
    assert verdict_on(found, "A step of the network") is Verdict.REPRODUCED
    assert verdict_on(found, "With the centre of gravity 2 m") is Verdict.UNDECIDED  # 0 of 24 excludes up to 14 %

    growth = {("mass", "8 t", FORCE): 3.0, ("mass", "32 t", FORCE): 2.0, ("friction", "0.5", FORCE): 4.0}
    growth |= {("tyre", "±10 %", FORCE): 1.05, ("tyre", "±20 %", FORCE): 1.24, ("tyre", "±30 %", FORCE): 1.5}
    growth |= {("friction", "0.5", "articulation_angle"): 2.0}
    found = findings(campaign(growth, lost=("cog", "-2 m", 1)))
    assert verdict_on(found, "A trailer mass other") is Verdict.REPRODUCED
    assert verdict_on(found, "On a road of friction 0.5") is Verdict.REPRODUCED
    assert verdict_on(found, "Friction hardly") is Verdict.NOT_REPRODUCED
    cog = next(f for f in found if f.claim.text.startswith("With the centre of gravity 2 m"))
    assert [e.value.value for e in cog.evidence] == [0.25] * 3


def test_missing_and_unfinished_studies_are_named(campaign, tmp_path: Path):
    with pytest.raises(UserError, match=r"not there yet(.|\n)*\nharness run ideal --out .*/ideal\n"):
        Results(tmp_path)
    campaign()
    write(tmp_path / "mass", {"level": design(status=lambda fates: fates.fill(-1))})
    with pytest.raises(UserError, match=r"mass: \d+ runs are still to come.*harness run mass --out"):
        _ = Results(tmp_path).stores


def test_a_study_without_the_level_compared_is_named(campaign, tmp_path: Path):
    campaign()
    write(tmp_path / "mass", {"level": design(estimators=EVERYONE, levels=(12.0, 24.0))})
    with pytest.raises(UserError, match="study 'mass' has no level '8 t'"):
        findings(Results(tmp_path))


def test_answer_is_that_of_the_joint_study(campaign):
    results = campaign()
    told = " ".join(str(vars(block)) for block in answer(results, findings(results)))
    assert "Over the whole box of perturbations EKF and UKF estimate the lateral force axle 21 best" in told
    drift = Joint(results).borne[1, 0].box
    assert 0.5 <= drift < 1.0  # at half the way to the heavy edge the error is 2 deg
    assert f"stays below 2.00° on every drive while all factors together stay within {100 * drift:.0f} %" in told
    assert re.search(r"articulation angle is driven by trailer mass \(total index 0\.[78]\d\) and friction \(", told)
    lost = int((results.stores["joint"].designs[0].status[:, 1] == 1).sum())
    assert f"EKF in 0 (0 % to 0.29 %) and UKF in {lost} (" in told


def test_first_page_of_a_study_has_its_findings_with_verdict_and_share(campaign, tmp_path: Path):
    campaign({("mass", "8 t", FORCE): 3.0, ("mass", "32 t", FORCE): 3.0})
    (section,) = hooks.first_page("study", Analysis(read(tmp_path / "mass")))
    (sheet,) = section.make()
    share = box.committed().share("The mass hardly affects the articulation angle")
    assert [row[0] for row in sheet.rows] == ["1", "6", "7"]
    assert [row[2] for row in sheet.rows] == ["reproduced, here (1 of 6 studies)", "reproduced", "reproduced"]
    assert sheet.rows[2][3].startswith(f"{100 * share.value:.0f} % (")
    assert not hooks.first_page("study", Analysis(read(tmp_path / "joint")))


def test_first_page_of_the_times_has_their_finding(campaign, tmp_path: Path):
    (section,) = hooks.first_page("times", campaign().times, tmp_path / "realtime")
    (sheet,) = section.make()
    assert [(row[0], row[2]) for row in sheet.rows] == [("15", "reproduced")]
    (section,) = first_page_of_times(campaign().times.sel(estimator=["EKF"]), tmp_path / "realtime")
    assert not section.make()


def test_report_is_written(campaign, tmp_path: Path):
    campaign()
    (tmp_path / "mass" / "report.html").write_text("the study")
    html, pdf, record = write_campaign(tmp_path, tmp_path / "campaign")
    kept = json.loads(record.read_text())["findings"]
    assert {f["verdict"] for f in kept} <= {v.value for v in Verdict}
    assert next(f for f in kept if f["finding"] == "EKF and UKF differ only marginally.")["studies"]
    text = html.read_text(encoding="utf-8")
    for words in (
        "How often does it fail?",
        "Bild 5.13 (tyre). ",
        "Bild 6.9 (computing time). ",
        "EKF and UKF differ only marginally.",
        "How it was made",
        '<a href="../mass/report.html#figure-1">mass</a>',
        "88 % (83 % to 92 %)",
        '<div id="figure-1">',
    ):
        assert words in text
    assert pdf.read_bytes().startswith(b"%PDF")


def test_trust_monitors_are_told_by_factor_and_size(campaign, tmp_path: Path):
    of_none = campaign()
    assert "Do the filters say" not in write_campaign(tmp_path, tmp_path / "campaign")[0].read_text(encoding="utf-8")
    assert trust.in_short(of_none) == ""
    level = trust_file.LevelTrust("level", "trailer mass 8 t", 0.47, 0.4, 0.26, 0.3, 0.097, Interval(0.64, 0.6, 0.7),
                                  (1.0, 0.3, 0.0))  # fmt: skip
    small = replace(level, label="trailer mass 24 t", wrong=0.0)
    target = trust_file.TargetTrust(FORCE, 2e3, (), (small, level), (1.0, 0.1, 0.0))
    watched = trust_file.EstimatorTrust("UKF", ("Often.",), Interval(1.7, 0.9, 3.0), (target,))
    study = SimpleNamespace(hash=of_none.stores["mass"].attributes["study_hash"], monitor=MonitorSpec({FORCE: 2e3}))
    trust_file.write(tmp_path / "mass", study, trust_file.StudyTrust(3.0, (watched,)))
    told = Results(tmp_path)
    assert trust.in_short(told) == (
        "UKF: samples in which the lateral force axle 21 is wrong by more than 2 kN, and share of these that its "
        "monitor says within 3 s: trailer mass 8 t 47 %, of these 40 %."
    )
    _, sheet, figure = trust.blocks(told, tmp_path / "campaign")
    (row,) = sheet.rows
    assert row[1:] == ["UKF", "1.7 (0.90 to 3.0)", "trailer mass 8 t", "47 %", "40 %", "0.300 s",
                       "0.64 (0.60 to 0.70)", "9.7 %"]  # fmt: skip
    assert figure.caption.startswith("Mass. Share of the samples in error")
    assert b"trailer mass 8 t: area 0.64" in figure.draw()
    text = write_campaign(tmp_path, tmp_path / "campaign")[0].read_text(encoding="utf-8")
    assert text.count("Do the filters say when they are not to be trusted?") >= 2  # in the answer and over the section
