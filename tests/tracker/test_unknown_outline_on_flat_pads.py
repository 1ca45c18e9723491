"""A flat pad touches an object that nobody drew: what its places tell of directions, outline and motion."""

import numpy as np
import pytest

import palpate
from palpate import GELSIGHT_MINI, ContactDirection, ContactPlace, Estimate, Frame, Measurement, Tracker, Unknown

HALF = 0.04
END = 0.5 * GELSIGHT_MINI.flat_width
SUNK = 3e-4


def tracked(seen: list[Frame], first: np.ndarray | None) -> list[Estimate]:
    tracker = Tracker(Unknown((0.06, 0.12)), GELSIGHT_MINI, first, palpate.TrackerSettings("none"))
    return [tracker.update(frame) for frame in seen]


def pressed(*measured: Measurement, frames: int = 30, lean: float = 0.0, rate: float = 30.0) -> list[Frame]:
    """Frames of a pad that pushes a square along x for 3 cm, through its middle."""
    return [
        Frame(k / rate, np.array((0.03 * k / frames - HALF + SUNK, 0.0, lean)), contact=True, measurements=measured)
        for k in range(frames)
    ]


def normal_angle(estimate: Estimate) -> float:
    """Angle [rad] of the inward normal in the world."""
    assert estimate.contact_normal is not None
    return float(np.arctan2(-estimate.contact_normal[1], -estimate.contact_normal[0]))


def place(y: float) -> ContactPlace:
    return ContactPlace(y, 0.0005**2)


def test_a_place_in_the_middle_is_touched_along_the_pads_own_normal():
    last = tracked(pressed(place(0.0)), np.zeros(3))[-1]
    assert normal_angle(last) == pytest.approx(0.0, abs=0.01)
    assert last.pose[0] == pytest.approx(0.03, abs=4e-3) and abs(last.pose[2]) < 0.05
    assert last.contact_point is not None
    assert np.allclose(last.contact_point, (0.029 - HALF, 0.0), atol=1.5e-3)


@pytest.mark.parametrize("side", (1.0, -1.0))
def test_a_place_near_an_end_tells_that_a_side_leans_to_it(side):
    directions = [
        normal_angle(tracked(pressed(place(side * y), frames=2), np.zeros(3))[0]) for y in (0.004, 0.007, END)
    ]
    leans = side * np.array(directions)
    assert 0.0 < leans[0] < leans[1] < leans[2] < 0.3


def test_a_measured_direction_says_whether_it_is_a_corner_or_a_side():
    corner = tracked(pressed(place(0.007), ContactDirection(0.0, 0.02**2)), np.zeros(3))[0]
    side = tracked(pressed(place(0.007), ContactDirection(0.15, 0.02**2)), np.zeros(3))[0]
    assert abs(normal_angle(corner)) < 0.05 < 0.1 < normal_angle(side)


def around(places: bool) -> list[Frame]:
    """Frames of a pad that is put flat onto each side of a resting square, at three places."""
    seen: list[Frame] = []
    for side in range(4):
        outward = np.array((np.cos(0.5 * np.pi * side), np.sin(0.5 * np.pi * side)))
        along = np.array((-outward[1], outward[0]))
        for shift in (-0.02, 0.0, 0.02):
            for step in range(8):
                is_touching = step < 6
                distance = HALF - SUNK if is_touching else HALF + 0.05
                pose = np.array((*(distance * outward + shift * along), 0.5 * np.pi * side + np.pi))
                measured = (place(0.0),) if is_touching and places else ()
                seen.append(Frame(len(seen) / 25.0, pose, contact=is_touching, measurements=measured))
    return seen


def test_a_square_that_rests_is_learnt_from_flat_contacts():
    outline = tracked(around(places=True), np.zeros(3))[-1].outline
    assert outline is not None
    off = np.abs(palpate.Rectangle(2.0 * HALF, 2.0 * HALF).signed_distance(outline.points))
    assert off[outline.touched].max() < 3e-3 and outline.touched.mean() > 0.2
    assert np.mean(off < 1.96 * outline.deviation) > 0.9


def test_without_places_a_pad_tells_less_and_the_status_says_so():
    with_places = tracked(around(places=True), np.zeros(3))[-1]
    without = tracked(around(places=False), np.zeros(3))[-1]
    assert without.status == "uncertain" and "contact directions" in without.reason
    assert with_places.outline is not None and without.outline is not None
    assert without.outline.sigma > with_places.outline.sigma


def test_the_first_contact_of_a_pad_makes_the_object_frame():
    """Its origin is half the least size behind the place that was touched."""
    first = tracked(pressed(ContactDirection(0.0, 0.01**2), place(0.005)), None)[0]
    assert first.pose[0] == pytest.approx(0.03 - HALF, abs=2e-3)
    assert first.pose[1] == pytest.approx(0.005, abs=1.5e-3)


def test_measurements_of_more_frames_say_more():
    """Variances are such that each frame counts; the outline is looked at less often."""
    directions = ContactDirection(0.0, 0.15**2)
    often = tracked(pressed(place(0.0), directions, frames=60, rate=60.0), np.zeros(3))[-1].outline
    seldom = tracked(pressed(place(0.0), directions, frames=6, rate=6.0), np.zeros(3))[-1].outline
    assert often is not None and seldom is not None
    assert often.sigma < seldom.sigma
