"""Simulated hands: two and three fingers push with their tips, two pinch, and files hold what each finger felt."""

from pathlib import Path

import numpy as np
import pytest

import palpate

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")


@pytest.fixture
def made(run_palpate, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def make(folder, *words, seconds=5):
        code, _, err = run_palpate("simulate", folder, "--count", "1", "--seconds", seconds, *words)
        assert code == 0, err
        return [palpate.load_recording(path) for path in sorted(Path(folder).iterdir())]

    return make


def change(image, other):
    """The largest difference of two images in a patch of 16 x 16 px [grey levels]."""
    patches = (image.astype(float) - other).reshape(20, 16, 15, 16, 3).mean(axis=(1, 3))
    return float(np.abs(patches).max())


def test_two_tips_push_and_each_has_images_contact_and_truth_of_its_own(made):
    (recording,) = made("out", "--fingers", "2", "--shape", "disc", "--ideal", "--seed", "1")
    assert recording.hand is not None and recording.images is not None and recording.contacts is not None
    assert list(recording.hand.fingers.values()) == [palpate.DIGIT, palpate.DIGIT]
    (_, left, _), (_, right, _) = recording.hand.mounts.values()
    assert 0.035 <= left - right <= 0.05
    touch = np.column_stack(list(recording.contacts.values()))
    assert touch.all(axis=1).sum() > 15 and (touch.any(axis=1) == recording.contact).all()
    gaps = recording.hand.gaps(recording.sensor_pose, recording.truth, recording.shape)
    blank, again = recording[0].images, recording[1].images
    for name, flags in recording.contacts.items():
        force = recording.extra[f"{name}/normal_force"]
        depth = recording.extra[f"{name}/indentation"]
        assert (force[~flags] == 0.0).all() and force[flags].max() > 0.5
        # Units have radii of their own, which nobody states.
        assert np.abs(gaps[name][flags]).max() < 0.003 and gaps[name][~flags].min() > -0.003
        deepest = recording[int(depth.argmax())].images
        assert blank is not None and again is not None and deepest is not None
        assert change(deepest[name], blank[name]) > 5.0 * change(again[name], blank[name])


def test_set_up_errors_are_in_each_finger_and_the_outline(made):
    (ideal,) = made("ideal", "--fingers", "2", "--shape", "0.1x0.08", "--no-images", "--ideal")
    (real,) = made("real", "--fingers", "2", "--shape", "0.1x0.08", "--no-images")
    assert ideal.set_up_sigma is not None and not ideal.set_up_sigma.any() and real.set_up_sigma is None
    assert real.shape != ideal.shape and real.first_pose_sigma[0] > 1e-3
    for recording, least, most in ((ideal, 0.0, 0.0), (real, 0.9e-3, 1.1e-3)):
        for name, pose in recording.hand.poses(recording.extra["sensor_pose_clean"]).items():
            true = recording.extra[f"{name}/sensor_pose_clean"]
            off = np.hypot(*(pose - true)[:, :2].T)
            assert (off >= least - 1e-9).all() and (off <= most + 1e-9).all()
    wrong = [real.extra[f"{name}/sensor_pose_clean"] for name in real.hand.fingers]
    assert not np.allclose(*(np.ptp(each, axis=0) for each in wrong), rtol=1e-6)


def test_the_same_seed_gives_the_same_files_and_three_fingers_touch(made):
    words = ("--fingers", "3", "--shape", "rectangle", "--no-images", "--seed", "4")
    (one,) = made("one", *words)
    made("two", *words)
    (name,) = [path.name for path in Path("one").iterdir()]
    assert (Path("one") / name).read_bytes() == (Path("two") / name).read_bytes()
    assert list(one.contacts) == ["left", "middle", "right"] and one.contact.any()


def test_a_pinch_closes_on_the_object_and_moves_it(made):
    (recording,) = made("out", "--fingers", "2", "--pinch", "--shape", "0.1x0.08", "--no-images", "--ideal", seconds=8)
    assert recording.finger_poses is not None and recording.contacts is not None
    both = np.all(list(recording.contacts.values()), axis=0)
    assert both.sum() > 30
    held = recording.truth[both]
    assert np.hypot(*(held[-1] - held[0])[:2]) > 0.005
    left = recording.finger_poses["left"]
    right = recording.finger_poses["right"]
    assert np.abs(np.abs((left - right)[:, 2]) % (2 * np.pi) - np.pi).max() < 0.02  # they face each other
    apart = np.hypot(*(left - right)[:, :2].T)
    assert apart[0] - apart[both].min() == pytest.approx(0.031, abs=0.002)  # 15 mm and the gel's depth each
    gaps = recording.hand.gaps(recording.sensor_pose, recording.truth, recording.shape, recording.finger_poses)
    assert all(np.abs(gap[both]).max() < 0.003 for gap in gaps.values())


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--fingers", "4"), "fingers is 4; allowed are 1 to 3"),
        (("--fingers", "3", "--pinch"), "a pinch has two fingers"),
        (("--pinch",), "fingers is 1"),
        (("--fingers", "2", "--pinch", "--knocks"), "no knocks"),
    ],
)
def test_hands_that_are_not_simulated_are_named(fails, tmp_path, words, named):
    assert named in fails("simulate", tmp_path / "out", *words)
