"""The table of statuses: which sign decides where there are several, and what the reason says."""

from typing import get_args

import pytest

from palpate.status import TABLE, Ambiguity, Evidence, FormEvidence, Implausible, InputEvidence, PoseEvidence, decide
from palpate.types.estimate import Status

KNOWN = PoseEvidence(in_contact=True, position_deviation=1e-3, yaw_deviation=0.01, is_beyond_tolerance=False)
TWO_PLACES = Ambiguity(0.02, 0.07, {"as before": 1, "shove": 2})
# Signs that decide the status, the strongest first.
SIGNS = (
    ("faulty", "the sensor may have moved 4 mm", {}, {"hidden_motion": 4e-3}),
    ("uncertain", "touch cannot measure before a release", {}, {"touches_since_start": True}),
    ("ambiguous", "3 poses up to 20 mm and 4 degrees from the best", {"ambiguity": TWO_PLACES}, {}),
    ("indeterminate", "no solution", {"has_begun_anew": True}, {}),
    ("strained", "up to 12 mm from the estimate", {"contradicting_poses": 0.012}, {}),
    ("strained", "put the outline up to 7 mm", {"contradicting_outline": 7e-3}, {}),
    ("strained", "the indentation is 5 standard deviations", {"implausible": Implausible("depth", 5.2)}, {}),
    ("displaced", "the object was moved", {"is_displaced": True}, {}),
    ("uncertain", "known to 2 mm and 1 degrees", {"is_beyond_tolerance": True}, {}),
    ("tracking", "", {}, {}),
)


@pytest.mark.parametrize("strongest", range(len(SIGNS)))
def test_the_strongest_sign_decides(strongest):
    status, words, _, _ = SIGNS[strongest]
    pose, stream = KNOWN, InputEvidence()
    for weaker in reversed(SIGNS[strongest:]):
        pose, stream = pose._replace(**weaker[2]), stream._replace(**weaker[3])
        if weaker is SIGNS[strongest]:
            verdict = decide(Evidence(pose, stream))
            assert verdict.status == status and words in verdict.reason
    alone = decide(Evidence(KNOWN._replace(**SIGNS[strongest][2]), InputEvidence(**SIGNS[strongest][3])))
    assert alone.status == status and words in alone.reason and (alone.reason == "") == (status == "tracking")


def test_each_status_has_a_row():
    assert {row.status for row in TABLE} == set(get_args(Status))


def test_an_object_that_is_untouched_rests():
    assert decide(Evidence(KNOWN._replace(in_contact=False))) == ("resting", "")


def test_an_ambiguous_estimate_says_where_its_poses_come_from():
    reason = decide(Evidence(KNOWN._replace(ambiguity=TWO_PLACES))).reason
    assert reason.endswith("the pose as before (1), a shove (2)")
    contradicted = decide(Evidence(KNOWN._replace(ambiguity=TWO_PLACES, contradicting_poses=0.012)))
    assert contradicted.status == "ambiguous"
    assert "up to 12 mm from the estimate" in contradicted.reason and "a shove (2)" in contradicted.reason


def test_an_implausible_variable_of_your_own_is_named():
    reason = decide(Evidence(KNOWN._replace(implausible=Implausible("stiffness", 12.0)))).reason
    assert "if stiffness is 12 standard deviations" in reason


def test_faults_of_the_stream_are_added_to_the_reason():
    stream = InputEvidence(doubt="another unit?", weakness="frames are slow")
    assert decide(Evidence(KNOWN, stream)) == ("tracking", "another unit?; frames are slow")
    assert decide(Evidence(KNOWN._replace(ambiguity=TWO_PLACES), stream)).reason.startswith("another unit?; 3 poses")
    frozen = stream._replace(hidden_motion=4e-3)
    assert "another unit" not in decide(Evidence(KNOWN, frozen)).reason


def test_images_whose_orientation_is_open_are_named_where_all_is_well():
    assert "not yet known" in decide(Evidence(KNOWN._replace(may_images_be_mirrored=True))).reason
    mirrored = KNOWN._replace(takes_images_as_mirrored=True)
    assert "upside down or mirrored" in decide(Evidence(mirrored)).reason
    assert "upside down" not in decide(Evidence(mirrored._replace(is_displaced=True))).reason


def test_a_yaw_of_more_than_half_a_turn_is_unknown():
    rough = KNOWN._replace(is_beyond_tolerance=True)
    assert "85 degrees" in decide(Evidence(rough._replace(yaw_deviation=0.74))).reason
    for deviation in (1.6, 3360.0):
        reason = decide(Evidence(rough._replace(yaw_deviation=deviation))).reason
        assert "2 mm" in reason and "unknown" in reason and "degrees" not in reason


def test_the_axis_of_motion_is_named_before_images_that_are_turned():
    mirrored = KNOWN._replace(takes_images_as_mirrored=True)
    slanted = decide(Evidence(mirrored, InputEvidence(push_angle=0.35))).reason
    assert slanted.startswith("the sensor moves +20 degrees off the x axis") and "upside down" in slanted
    sideways = decide(Evidence(mirrored, InputEvidence(push_angle=1.6, weakness="along y"))).reason
    assert sideways.startswith("along y; touch fits")
    assert decide(Evidence(KNOWN, InputEvidence(push_angle=0.35))) == ("tracking", "")


WHOLE = FormEvidence(untouched_share=0.0, deviation=2e-3, is_beyond_tolerance=False, has_directions=True)


@pytest.mark.parametrize(
    ("status", "words", "signs"),
    [
        ("strained", "230 mm wide", {"exceeding_width": 0.23, "untouched_share": 0.6}),
        ("strained", "21 mm from the sketch", {"from_sketch": 0.021, "is_beyond_tolerance": True}),
        ("strained", "23% smaller than the sketch", {"larger_than_sketch": -0.23, "is_beyond_tolerance": True}),
        ("strained", "in 40% of contacts", {"shoved_share": 0.4, "is_beyond_tolerance": True}),
        ("uncertain", "nothing was touched", {"has_directions": False, "untouched_share": 1.0}),
        ("uncertain", "contact directions", {"has_directions": False, "untouched_share": 0.6}),
        ("uncertain", "enclose nothing", {"untouched_share": 0.6, "is_beyond_tolerance": True}),
        ("uncertain", "40% of the outline", {"untouched_share": 0.4}),
        ("uncertain", "known to 4 mm", {"is_beyond_tolerance": True}),
        ("tracking", "", {}),
    ],
)
def test_an_outline_that_is_learnt_decides_while_the_pose_is_known(status, words, signs):
    verdict = decide(Evidence(KNOWN._replace(form=WHOLE._replace(**signs))))
    assert verdict.status == status and words in verdict.reason and (verdict.reason == "") == (status == "tracking")
