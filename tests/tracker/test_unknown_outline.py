"""An object that nobody drew is touched from all sides: its outline is found, with a band that is honest."""

import numpy as np
import pytest

import palpate
from palpate import DIGIT, ContactDirection, Disc, Frame, Sketch, Tracker, TrackerSettings, Unknown

RADIUS = 0.06
DISC = Disc(RADIUS)


def touches(radius: float, sides: int = 8, frames: int = 12) -> list[Frame]:
    """Frames of a tip that touches a resting disc about the origin head on from several sides."""
    seen: list[Frame] = []
    for side in range(sides):
        way = 2.0 * np.pi * side / sides
        outward = np.array((np.cos(way), np.sin(way)))
        for step in range(frames + 3):
            is_touching = step < frames
            place = (radius - 3e-4 if is_touching else radius + 0.05) * outward
            pose = np.array((*place, way + np.pi))
            measured = (ContactDirection(0.0, 0.02**2),) if is_touching else ()
            seen.append(Frame(len(seen) / 30.0, pose, contact=is_touching, measurements=measured))
    return seen


def tracked(shape: Unknown | Sketch, radius: float = RADIUS, first: np.ndarray | None = None) -> list[palpate.Estimate]:
    tracker = Tracker(shape, DIGIT, first, TrackerSettings("none"))
    return [tracker.update(frame) for frame in touches(radius)]


def test_an_outline_is_found_where_it_is_touched_and_its_band_holds():
    estimates = tracked(Unknown((0.05, 0.2)))
    last = estimates[-1]
    assert last.outline is not None
    placed = last.outline.points @ rotation(last.pose[2]).T + last.pose[:2]
    off = np.abs(np.hypot(*placed.T) - RADIUS)
    assert off[last.outline.touched].max() < 0.003
    assert np.mean(off < 2.0 * last.outline.deviation) > 0.9
    first = next(one for one in estimates if one.contact).outline
    assert first is not None
    assert first.deviation.max() > 4.0 * last.outline.deviation.max()
    assert first.deviation[first.touched].max() < 0.5 * first.deviation.max()


def test_contacts_on_one_side_enclose_nothing():
    first = next(one for one in tracked(Unknown((0.05, 0.2))) if one.contact)
    assert first.status == "uncertain"
    assert "enclose nothing" in first.reason


def test_a_sketch_that_no_contact_fits_is_contradicted():
    last = tracked(Sketch(Disc(0.045), 0.002), first=np.zeros(3))[-1]
    assert last.status == "strained"
    assert "sketch" in last.reason


def test_the_next_push_is_at_the_side_that_was_not_touched():
    contact = next(one for one in tracked(Unknown((0.05, 0.2))) if one.contact)
    push = palpate.next_push(contact)
    assert push.point[0] < 0.02  # the first contact is at x = RADIUS
    assert push.information > 1.0
    assert np.hypot(*push.direction) == pytest.approx(1.0)


@pytest.mark.parametrize("size", [(0.2, 0.05), (0.0, 0.1), 0.1, (0.05, "wide")])
def test_sizes_that_are_not_allowed_are_named(size):
    with pytest.raises(palpate.SettingError, match="size"):
        Unknown(size)


def rotation(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
