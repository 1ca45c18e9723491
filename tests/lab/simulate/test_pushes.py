from dataclasses import fields

import numpy as np
import pytest

from palpate.errors import SettingError
from palpate.geometry import se2
from palpate.geometry.shapes import Disc, Ellipse, Polygon, Rectangle
from palpate.lab.simulate.places import draw_touch, kinds
from palpate.lab.simulate.pushes import draw_sequence, measured
from palpate.lab.simulate.world import Motion
from palpate.types.recording import episode_numbers
from palpate.types.sensor import DIGIT

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")

DISC, RECTANGLE, ELLIPSE = Disc(0.088), Rectangle(0.2363, 0.1579), Ellipse(0.1638, 0.2428)
TEE = Polygon(
    [(-0.1, 0.02), (-0.03, 0.02), (-0.03, -0.12), (0.03, -0.12), (0.03, 0.02), (0.1, 0.02), (0.1, 0.08), (-0.1, 0.08)]
)
TRIANGLE = Polygon([(-0.1, -0.06), (0.1, -0.06), (0.0, 0.12)])
CLASSES = [(shape, kind) for shape in (DISC, RECTANGLE, ELLIPSE, TRIANGLE, TEE) for kind in kinds(shape)]
CENTER = (-DIGIT.radius, 0.0, 0.0)


def arrays(sequence):
    return {"sensor_pose": sequence.sensor_pose, **{f.name: getattr(sequence.motion, f.name) for f in fields(Motion)}}


@pytest.fixture(scope="module")
def sequences():
    paper = [(shape, kind) for shape, kind in CLASSES if not isinstance(shape, Polygon)]
    return [(shape, draw_sequence(shape, kind, DIGIT, np.random.default_rng(1))) for shape, kind in paper]


def test_the_kinds_of_the_paper_s_objects():
    assert kinds(DISC) == ("disc",)
    assert kinds(ELLIPSE) == ("ellipse",)
    assert kinds(RECTANGLE) == ("rectangle-edges", "rectangle-near-corners", "rectangle-corners")
    many = Polygon(DISC.outline(60))
    assert kinds(many) == ("polygon-edges",)


def test_a_sequence_makes_and_breaks_contact_two_or_three_times(sequences):
    for _, sequence in sequences:
        assert len(sequence.time) == len(sequence.sensor_pose) == 450
        assert sequence.time[-1] == pytest.approx(449 / 30)
        contact = sequence.motion.contact
        assert 2 <= episode_numbers(contact).max() + 1 <= 3
        assert 0.3 < contact.mean() < 0.9
        assert not contact[0] and not contact[-1]


def test_the_sensor_goes_clear_of_the_object_and_without_jumps(sequences):
    for shape, sequence in sequences:
        motion = sequence.motion
        centers = se2.compose(se2.between(motion.object_pose, sequence.sensor_pose), CENTER)
        gap = shape.signed_distance(centers[:, :2]) - DIGIT.radius
        assert (gap[~motion.contact] > -1e-4).all()
        assert (gap[motion.contact] < 1e-4).all()
        steps = np.hypot(*np.diff(sequence.sensor_pose[:, :2], axis=0).T)
        assert steps.max() * DIGIT.rate < 0.6  # [m/s]
        assert np.hypot(*np.diff(sequence.sensor_pose[:, :2], n=2, axis=0).T).max() * DIGIT.rate**2 < 5.0  # [m/s^2]
        # What is not touched does not move.
        alone = ~motion.contact[1:] & ~motion.contact[:-1]
        moved = np.abs(np.diff(motion.object_pose, axis=0))[alone]
        assert moved.max() < 2e-4
        pushing = np.hypot(*np.diff(motion.object_pose[:, :2], axis=0).T)[motion.contact[1:]]
        assert 0.002 < np.median(pushing) * DIGIT.rate < 0.05


def test_most_contacts_are_on_the_pad(sequences):
    angles = np.concatenate([np.abs(s.motion.pad_angle[s.motion.contact]) for _, s in sequences])
    assert np.mean(angles < np.radians(26.0)) > 0.9
    assert np.mean(angles > np.radians(15.0)) > 0.05
    slip = np.concatenate([np.abs(s.motion.slip[s.motion.contact]) for _, s in sequences])
    assert 0.03 < np.mean(slip > 1e-3) < 0.7


def test_the_same_seed_gives_the_same_arrays_and_another_seed_others():
    first, again, other = (
        arrays(draw_sequence(RECTANGLE, "rectangle-edges", DIGIT, np.random.default_rng(seed), 4.0))
        for seed in (7, 7, 8)
    )
    assert not first.pop("knocked").any()
    for name, value in first.items():
        assert value.tobytes() == again[name].tobytes(), name
        assert value.tobytes() != other[name].tobytes(), name


def test_random_sequences_hold():
    for index in range(22):
        shape, kind = CLASSES[index % len(CLASSES)]
        sequence = draw_sequence(shape, kind, DIGIT, np.random.default_rng([2, index]), 3.0 + 0.1 * index)
        values = arrays(sequence)
        angle = values.pop("pad_angle")
        assert (np.isnan(angle) == ~sequence.motion.contact).all()
        for name, value in values.items():
            assert np.isfinite(value).all(), name
        assert len(sequence.time) == round((3.0 + 0.1 * index) * 30)
        assert sequence.motion.indentation.max() < 3e-3
        assert sequence.motion.contact.any()
        assert np.abs(np.diff(sequence.motion.object_pose[:, :2], axis=0)).max() < 4e-3


@pytest.mark.parametrize(("shape", "kind"), CLASSES, ids=lambda value: value if isinstance(value, str) else "")
def test_a_touch_is_where_its_kind_says(shape, kind):
    rng = np.random.default_rng(0)
    for _ in range(50):
        touch = draw_touch(shape, kind, DIGIT, rng)
        center = se2.compose(touch.sensor_pose, CENTER)
        assert shape.signed_distance(center[:2]) == pytest.approx(DIGIT.radius, abs=1e-4)
        outline = shape.outline(4000)
        point = outline[np.argmin(np.hypot(*(outline - center[:2]).T))]
        inward = np.arctan2(*(point - center[:2])[::-1])
        assert abs(se2.wrap(float(inward - touch.sensor_pose[2]))) < np.radians(13.0)
        assert abs(se2.wrap(float(inward - touch.heading))) < np.radians(46.0)
        if isinstance(shape, Rectangle):
            away = np.hypot(*(shape.corners - point).T).min()
            low, high = {"edges": (0.0149, 0.2), "near-corners": (0.0015, 0.0081), "corners": (0.0, 2e-4)}[
                kind.removeprefix("rectangle-")
            ]
            assert low <= away <= high


def test_measured_poses_have_the_noise_of_motion_capture():
    poses = np.tile((1.0, -2.0, np.pi - 1e-4), (20000, 1))
    noisy = measured(poses, np.random.default_rng(0))
    error = se2.wrap(noisy - poses)
    sigma = error.std(axis=0)
    assert sigma[:2] == pytest.approx(1e-4, rel=0.03)
    assert np.radians(0.1) * 0.97 < sigma[2] < np.radians(0.2) * 1.03
    assert np.abs(noisy[:, 2]).max() <= np.pi
    assert poses[0, 2] == np.pi - 1e-4


def test_bad_requests_are_named():
    rng = np.random.default_rng(0)
    with pytest.raises(SettingError, match="'ellipse'; a disc allows"):
        draw_sequence(DISC, "ellipse", DIGIT, rng)
    with pytest.raises(SettingError, match=r"2\.0 s was asked for; allowed is 3\.0 to 600\.0"):
        draw_sequence(DISC, "disc", DIGIT, rng, seconds=2.0)
