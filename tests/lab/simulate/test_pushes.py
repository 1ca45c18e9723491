"""Recordings of `palpate simulate`: contacts of each kind, the sensor's way, knocks, and the errors of a set-up."""

from pathlib import Path
from typing import Any

import numpy as np
import planar
import pytest

import palpate

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")


@pytest.fixture(scope="module")
def simulated(command, tmp_path_factory):
    """Return recordings by name of a folder that the command makes with these options."""

    def run(*words):
        folder = tmp_path_factory.mktemp("simulated") / "out"
        assert command("simulate", folder, "--no-images", *words) == 0
        return {path.stem.rsplit("-", 1)[0]: palpate.load_recording(path) for path in sorted(Path(folder).iterdir())}

    return run


@pytest.fixture(scope="module")
def pushes(simulated):
    words = ("--seed", "1", "--ideal", "--count")  # a rectangle is pushed at another place in each of three
    return simulated("--shape", "disc", "--shape", "ellipse", *words, "1") | simulated(
        "--shape", "rectangle", *words, "3"
    )


def centers(recording):
    """Return the gel's centre of curvature in the object frame (N, 2), for the nominal radius."""
    g = planar.between(recording.extra["object_pose_clean"], recording.extra["sensor_pose_clean"])
    return planar.transform(g, np.broadcast_to([-recording.sensor.radius, 0.0], (len(g), 2)))


def onsets(recording):
    return np.flatnonzero(np.diff(recording.contact, prepend=False) & recording.contact)


def test_a_contact_is_of_its_kind(pushes):
    assert pushes.keys() == {"disc", "ellipse", *(f"rectangle-{at}" for at in ("edges", "near-corners", "corners"))}
    for name, recording in pushes.items():
        first = onsets(recording)
        assert 2 <= len(first) <= 3 and 0.3 < recording.contact.mean() < 0.9
        assert len(recording) == 450 and not recording.contact[0] and not recording.contact[-1]
        assert np.abs(recording.extra["pad_angle"][first]).max() < np.radians(14.0)
        if name.startswith("rectangle"):
            outline = recording.shape.outline(4000)
            for center in centers(recording)[first]:
                point = outline[np.argmin(np.hypot(*(outline - center).T))]
                away = np.hypot(*(recording.shape.corners - point).T).min()
                limits = {"edges": (0.013, 0.2), "near-corners": (0.001, 0.01), "corners": (0.0, 2e-3)}
                low, high = limits[name.removeprefix("rectangle-")]
                assert low <= away <= high, name


def test_the_contact_stays_on_the_pad_and_some_slide(pushes):
    touched = [
        (abs(each.extra["pad_angle"][each.contact]), abs(each.extra["slip"][each.contact])) for each in pushes.values()
    ]
    angle, slip = (np.concatenate(each) for each in zip(*touched, strict=True))
    assert np.mean(angle < np.radians(26.0)) > 0.9 and np.mean(angle > np.radians(15.0)) > 0.05
    assert 0.03 < np.mean(slip > 1e-3) < 0.7


def test_the_sensor_goes_clear_of_the_object_and_without_jumps(pushes):
    for recording in pushes.values():
        contact, depth = recording.contact, recording.extra["indentation"]
        gap = recording.shape.signed_distance(centers(recording)) - recording.sensor.radius
        assert (gap[~contact] > -4e-4).all()  # a gel is up to 1.5 mm less or more round
        assert np.abs(gap + depth)[contact].max() < 4e-4 and depth.max() < 3e-3 and (depth[contact] > 0.0).all()
        assert (np.isnan(recording.extra["pad_angle"]) == ~contact).all()
        steps = np.diff(recording.extra["sensor_pose_clean"][:, :2], axis=0)
        assert np.hypot(*steps.T).max() * 30.0 < 0.6  # [m/s]
        assert np.hypot(*np.diff(steps, axis=0).T).max() * 900.0 < 5.0  # [m/s^2]
        moved = np.abs(np.diff(recording.extra["object_pose_clean"], axis=0))
        assert moved[~contact[1:] & ~contact[:-1]].max() < 2e-4
        assert 0.002 < np.median(np.hypot(*moved[contact[1:], :2].T)) * 30.0 < 0.05


def test_a_flat_pad_stays_flat_on_the_object(simulated):
    words = ("--shape", "disc", "--count", "1", "--seconds", "6", "--sensor", "gelsight-mini", "--ideal")
    recording = simulated(*words)["disc"]
    assert recording.sensor == palpate.GELSIGHT_MINI and recording.contact.mean() > 0.3
    assert np.nanmax(np.abs(recording.extra["pad_angle"])) < np.radians(40.0)


@pytest.mark.parametrize(("shape", "count"), [("disc", 1), ("rectangle", 3), ("triangle", 3)])
def test_every_sequence_is_knocked(simulated, shape, count):
    """In contact the object jumps; in a pause it comes no nearer to the sensor."""
    words = ("--shape", shape, "--count", count, "--seed", "3", "--seconds", "15", "--knocks", "--ideal")
    for recording in simulated(*words).values():
        knocked = recording.extra["knocked"] > 0.0
        pose = recording.extra["object_pose_clean"]
        way = np.hypot(*np.diff(pose[:, :2], axis=0).T)
        assert knocked.any() and recording.extra["indentation"].max() < 3e-3
        assert way[knocked[1:]].max() > 2.0 * np.median(way[recording.contact[1:]])
        alone = np.flatnonzero(knocked & (np.convolve(recording.contact, np.ones(31), "same") == 0.0))
        if len(alone):
            away = np.hypot(*centers(recording).T) if shape == "disc" else np.array([0.0, 0.0])
            assert away[min(alone[-1] + 5, len(away) - 1)] > away[max(min(alone[0], len(away)) - 1, 0)] - 1e-4


def test_errors_of_a_set_up_have_the_stated_size(command, tmp_path):
    words = ("simulate", tmp_path / "out", "--shape", "disc", "--count", "36", "--seconds", "3", "--no-images")
    assert command(*words) == 0
    made: list[Any] = [palpate.load_recording(path) for path in sorted((tmp_path / "out").iterdir())]
    exact = [each.extra["object_pose_clean"][0] for each in made]
    mounting = np.array(
        [planar.between(each.extra["sensor_pose_clean"], each.sensor_pose).mean(axis=0) for each in made]
    )
    first = np.array([planar.between(pose, each.first_pose) for pose, each in zip(exact, made, strict=True)])
    outline = np.array([each.shape.radius for each in made]) / 0.088 - 1.0
    # The noise of motion capture averages out over 90 frames; that of the first pose is 0.1 mm and 0.2 degrees.
    np.testing.assert_allclose(np.hypot(*mounting[:, :2].T), 1e-3, atol=6e-5)
    np.testing.assert_allclose(np.abs(mounting[:, 2]), np.radians(1.0), atol=1.2e-3)
    length, turn = np.hypot(*first[:, :2].T), np.degrees(np.abs(first[:, 2]))
    assert 1.6e-3 <= length.min() < 2.6e-3 and 4.4e-3 < length.max() <= 5.4e-3
    assert turn.min() >= 0.3 and turn.max() <= 3.7
    assert (np.abs(outline) >= 0.0099).all() and (np.abs(outline) <= 0.0201).all()
    for signs in (mounting[:, 0], mounting[:, 2], first[:, 1], first[:, 2], outline):
        assert abs(np.mean(signs > 0.0) - 0.5) < 0.25
    np.testing.assert_allclose(np.sqrt(np.mean(first**2, axis=0)), made[0].first_pose_sigma, rtol=0.3)
