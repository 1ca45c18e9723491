"""Sequences of pushes: contacts of each kind, a sensor clear of the object in between, and knocks."""

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from palpate import DIGIT, GELSIGHT_MINI, Disc, Ellipse, Polygon, Rectangle, SettingError, Shape
from palpate.geometry import se2
from palpate.lab.simulate.paths import draw_touch, kinds
from palpate.lab.simulate.pushes import draw_sequence, measured
from palpate.lab.simulate.world import Motion, World

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")

DISC, RECTANGLE, ELLIPSE = Disc(0.088), Rectangle(0.2363, 0.1579), Ellipse(0.1638, 0.2428)
TEE = Polygon(
    [(-0.1, 0.02), (-0.03, 0.02), (-0.03, -0.12), (0.03, -0.12), (0.03, 0.02), (0.1, 0.02), (0.1, 0.08), (-0.1, 0.08)]
)
TRIANGLE = Polygon([(-0.1, -0.06), (0.1, -0.06), (0.0, 0.12)])
KINDS = [(shape, kind) for shape in (DISC, RECTANGLE, ELLIPSE, TRIANGLE, TEE) for kind in kinds(shape)]
CENTER = (-DIGIT.radius, 0.0, 0.0)


def drawn(shape: Shape = RECTANGLE, seed: Any = 7, knocks: int | None = None, seconds=4.0, sensor=DIGIT, kind=None):
    hand = None if knocks is None else np.random.default_rng(knocks)
    return draw_sequence(shape, kind or kinds(shape)[0], sensor, np.random.default_rng(seed), seconds, hand)


def arrays(sequence):
    motion = {field.name: getattr(sequence.motion, field.name) for field in fields(Motion)}
    return {"sensor_pose": sequence.sensor_pose, **motion}


@pytest.fixture(scope="module")
def sequences():
    paper = [(shape, kind) for shape, kind in KINDS if not isinstance(shape, Polygon)]
    return [(shape, drawn(shape, 1, seconds=15.0, kind=kind)) for shape, kind in paper]


def test_kinds_of_contact():
    assert kinds(DISC) == ("disc",) and kinds(ELLIPSE) == ("ellipse",)
    assert kinds(RECTANGLE) == ("rectangle-edges", "rectangle-near-corners", "rectangle-corners")
    assert kinds(Polygon(DISC.outline(60))) == ("polygon-edges",)


@pytest.mark.parametrize(("shape", "kind"), KINDS, ids=lambda value: value if isinstance(value, str) else "")
def test_a_contact_is_of_its_kind(shape, kind):
    rng = np.random.default_rng(0)
    for _ in range(30):
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
            limits = {"edges": (0.0149, 0.2), "near-corners": (0.0015, 0.0081), "corners": (0.0, 2e-4)}
            low, high = limits[kind.removeprefix("rectangle-")]
            assert low <= away <= high


def test_contacts_are_made_and_broken_two_or_three_times(sequences):
    angles, slip = [], []
    for _, sequence in sequences:
        contact = sequence.motion.contact
        assert len(sequence.time) == len(sequence.sensor_pose) == 450
        assert sequence.time[-1] == pytest.approx(449 / 30)
        assert 2 <= np.sum(np.diff(contact, prepend=False) & contact) <= 3 and 0.3 < contact.mean() < 0.9
        assert not contact[0] and not contact[-1]
        angles.append(np.abs(sequence.motion.pad_angle[contact]))
        slip.append(np.abs(sequence.motion.slip[contact]))
    angle = np.concatenate(angles)
    assert np.mean(angle < np.radians(26.0)) > 0.9 and np.mean(angle > np.radians(15.0)) > 0.05
    assert 0.03 < np.mean(np.concatenate(slip) > 1e-3) < 0.7  # some contacts stick and some slide


def test_the_sensor_goes_clear_of_the_object_and_without_jumps(sequences):
    for shape, sequence in sequences:
        motion = sequence.motion
        centers = se2.compose(se2.between(motion.object_pose, sequence.sensor_pose), CENTER)
        gap = shape.signed_distance(centers[:, :2]) - DIGIT.radius
        assert (gap[~motion.contact] > -1e-4).all() and (gap[motion.contact] < 1e-4).all()
        steps = np.diff(sequence.sensor_pose[:, :2], axis=0)
        assert np.hypot(*steps.T).max() * DIGIT.rate < 0.6  # [m/s]
        assert np.hypot(*np.diff(steps, axis=0).T).max() * DIGIT.rate**2 < 5.0  # [m/s^2]
        alone = ~motion.contact[1:] & ~motion.contact[:-1]
        assert np.abs(np.diff(motion.object_pose, axis=0))[alone].max() < 2e-4
        pushing = np.hypot(*np.diff(motion.object_pose[:, :2], axis=0).T)[motion.contact[1:]]
        assert 0.002 < np.median(pushing) * DIGIT.rate < 0.05


@pytest.mark.parametrize("index", range(0, 22, 2))
def test_random_sequences_hold(index):
    shape, kind = KINDS[index % len(KINDS)]
    sequence = drawn(shape, [2, index], seconds=3.0 + 0.1 * index, kind=kind)
    values = arrays(sequence)
    assert (np.isnan(values.pop("pad_angle")) == ~sequence.motion.contact).all() and sequence.motion.contact.any()
    assert all(np.isfinite(value).all() for value in values.values())
    assert len(sequence.time) == round((3.0 + 0.1 * index) * 30) and sequence.motion.indentation.max() < 3e-3
    assert np.abs(np.diff(sequence.motion.object_pose[:, :2], axis=0)).max() < 4e-3


def test_a_flat_pad_stays_flat_on_the_object():
    motion = drawn(Disc(0.06), 1, sensor=GELSIGHT_MINI, seconds=6.0).motion
    assert motion.contact.mean() > 0.3 and np.nanmax(np.abs(motion.pad_angle)) < np.radians(40.0)
    touch = draw_touch(RECTANGLE, "rectangle-edges", GELSIGHT_MINI, np.random.default_rng(0))
    parts = se2.transform(touch.sensor_pose[None], GELSIGHT_MINI.round_centers)
    assert RECTANGLE.signed_distance(parts).min() == pytest.approx(GELSIGHT_MINI.radius, abs=1e-9)


def test_measured_poses_have_the_noise_of_motion_capture():
    poses = np.tile((1.0, -2.0, np.pi - 1e-4), (20000, 1))
    noisy = measured(poses, np.random.default_rng(0))
    sigma = se2.wrap(noisy - poses).std(axis=0)
    assert sigma[:2] == pytest.approx(1e-4, rel=0.03) and np.abs(noisy[:, 2]).max() <= np.pi
    assert np.radians(0.1) * 0.97 < sigma[2] < np.radians(0.2) * 1.03


def test_nothing_differs_before_the_first_knock():
    plain, first, again, other = (arrays(drawn(knocks=knocks)) for knocks in (None, 1, 1, 2))
    begin = int(np.argmax(first["knocked"]))
    assert begin > 20
    for name, value in first.items():
        assert value.tobytes() == again[name].tobytes(), name
        assert value[:begin].tobytes() == plain[name][:begin].tobytes(), name
    assert first["object_pose"].tobytes() != other["object_pose"].tobytes()


@pytest.mark.parametrize("shape", [DISC, RECTANGLE, TRIANGLE], ids=["disc", "rectangle", "triangle"])
def test_every_sequence_is_knocked_by_a_finger_that_has_room(shape, monkeypatch):
    begun, begin = [], World.shove

    def watched(world, shove):
        begun.append((shove, world.object_pose, world.sensor_pose))
        begin(world, shove)

    monkeypatch.setattr(World, "shove", watched)
    for seed in range(2):
        motion = drawn(shape, seed, seed, 7.0).motion
        assert motion.knocked.any() and motion.indentation.max() < 3e-3 and np.isfinite(motion.object_pose).all()
        way = np.hypot(*np.diff(motion.object_pose[:, :2], axis=0).T)
        assert way[motion.knocked[1:]].max() > 2.0 * np.median(way[motion.contact[1:]])
    assert len(begun) >= 2
    for shove, object_pose, sensor_pose in begun:
        pushed = se2.transform(object_pose, shove.point)
        assert shape.signed_distance(shove.point) == pytest.approx(0.0, abs=1e-4)
        assert np.hypot(*(pushed - se2.transform(sensor_pose, DIGIT.centers[0]))) > DIGIT.radius
        before = pushed - 0.01 * np.array([np.cos(shove.direction), np.sin(shove.direction)])
        assert shape.signed_distance(se2.transform(se2.inverse(object_pose), before)) > 0.005


def test_an_object_shoved_in_a_pause_comes_no_nearer_to_the_sensor():
    found = 0
    for seed in range(4):
        sequence = drawn(DISC, seed, seed, 15.0)
        motion, sensor_pose = sequence.motion, sequence.sensor_pose
        stands = np.append(False, np.abs(np.diff(sensor_pose, axis=0)).max(axis=1) < 1e-12)
        alone = np.flatnonzero(motion.knocked & stands)
        if len(alone):
            found += 1
            first, last = alone[0] - 1, alone[-1] + 5
            away = np.hypot(*(motion.object_pose[:, :2] - se2.compose(sensor_pose, CENTER)[:, :2]).T)
            assert away[last] > away[first] - 1e-4 and not motion.contact[first : last + 1].any()
    assert found


def test_bad_requests_are_named():
    with pytest.raises(SettingError, match="'ellipse'; a disc allows"):
        drawn(DISC, kind="ellipse")
    with pytest.raises(SettingError, match=r"seconds is 2; allowed is 3 to 600"):
        drawn(DISC, seconds=2.0)
