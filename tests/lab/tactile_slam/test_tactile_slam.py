"""The baseline of outlines that are not known: its Gaussian process, its graph, and both in turn."""

import numpy as np
import pytest

from palpate import ContactDirection, Frame, Rectangle, SensorProfile, Unknown
from palpate_lab.tactile_slam.smoother import Pressure
from palpate_lab.tactile_slam.tracking import SlamSettings, TactileSlam

TIP = SensorProfile("tip", radius=0.005)
DEPTH = SlamSettings().indentation
SURE = np.diag(np.square((1e-4, 1e-4, 1e-3)))
SQUARE = Rectangle(0.1, 0.1)
C = SQUARE.friction_radius()


def touches() -> list[Frame]:
    """Frames of a tip that touches each side of a square at rest in five places."""
    frames: list[Frame] = []
    for side in range(4):
        way = 0.5 * np.pi * side
        outward = np.array((np.cos(way), np.sin(way)))
        along = np.array((-np.sin(way), np.cos(way)))
        for place in np.linspace(-0.04, 0.04, 5):
            apex = (0.05 - DEPTH) * outward + place * along
            away = apex + 0.03 * outward
            measured = (ContactDirection(0.0, 0.03**2),)
            time = float(len(frames))
            frames.append(Frame(time, np.array((*apex, way + np.pi)), contact=True, measurements=measured))
            frames.append(Frame(time + 0.5, np.array((*away, way + np.pi)), contact=False))
    return frames


def slam_of(first: np.ndarray, covariance: np.ndarray = SURE) -> TactileSlam:
    return TactileSlam(Unknown((0.05, 0.2)), TIP, first, covariance, Pressure(C, np.zeros(2)))


def test_the_outline_of_a_square_at_rest_is_found_with_its_band():
    slam = slam_of(np.zeros(3))
    for frame in touches():
        slam.step(frame, frame.measurements)
    outline = slam.outline()
    off = np.abs(SQUARE.signed_distance(outline.points))
    assert np.sqrt(np.mean(off**2)) < 1e-3
    assert np.all(off < 3.0 * outline.deviation) and outline.deviation.max() < 0.01
    assert 0.4 < outline.touched.mean() < 1.0


def test_a_tip_beside_the_middle_turns_the_object_as_the_friction_radius_says():
    """A step d that sticks turns the object by d y / (c^2 + x^2 + y^2), where (x, y) is the contact point."""
    lever = 0.03
    slam = slam_of(np.zeros(3))
    moved = turn = 0.0
    for step in range(20):
        moved = 1e-4 * step
        turn = -moved * lever / (C**2 + 0.05**2 + lever**2)
        apex = np.array((-0.05 + DEPTH + moved, lever, 0.0))
        slam.step(Frame(step / 30.0, apex, contact=True), [ContactDirection(turn, 0.03**2)])
    assert slam.pose[2] == pytest.approx(turn, rel=0.25)
    assert slam.pose[0] == pytest.approx(moved + turn * lever, rel=0.1)


def test_a_side_that_was_touched_tells_of_the_pose():
    """A contact in front of the learnt side is taken as a motion of the object, as its place is not known well."""
    slam = slam_of(np.zeros(3), np.diag(np.square((0.01, 1e-4, 1e-3))))
    for frame in touches():
        slam.step(frame, frame.measurements)
    before = slam.pose
    ahead = np.array((0.052 - DEPTH, 0.0, np.pi))
    slam.step(Frame(100.0, ahead, contact=True), [ContactDirection(0.0, 0.03**2)])
    assert 2e-4 < slam.pose[0] - before[0] < 6e-3
    assert slam.pose[1:] == pytest.approx(before[1:], abs=5e-4)
