"""A tracker that is saved and loaded goes on as if nothing had happened, to the last digit."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from push_samples import SHAPES, frames, in_two_contacts, pushed, sensor
from tracker_samples import settings

from palpate.config import TrackerSettings
from palpate.errors import FileError, SettingError
from palpate.lab.simulate.recordings import simulate_recording
from palpate.saved_state import StateFile, write_state
from palpate.touch.background import Background
from palpate.touch.calibration import Calibration, DirectionCorrection
from palpate.touch.camera_view import CameraView
from palpate.touch.relative import NoTouch
from palpate.tracker import Tracker
from palpate.types.frame import Frame
from palpate.types.measurements import ObjectPose, OwnMeasurement
from palpate.types.sensor import DIGIT


def goes_on(tracker: Tracker, seen: list[Frame], at: int, path: Path, before: int = 0) -> Tracker:
    """Compare a tracker that goes on from frame `at` with one that is saved and loaded there."""
    for frame in seen[before:at]:
        tracker.update(frame)
    tracker.save(path)
    loaded = Tracker.load(path)
    assert (loaded.tactile, loaded.tactile_reason) == (tracker.tactile, tracker.tactile_reason)
    for frame in seen[at:]:
        assert loaded.update(frame) == tracker.update(frame)
    one, other = loaded.smoothed(), tracker.smoothed()
    np.testing.assert_array_equal(one.pose, other.pose)
    np.testing.assert_array_equal(one.time, other.time)
    np.testing.assert_array_equal(one.contact, other.contact)
    return loaded


@pytest.fixture(scope="module")
def recording():
    """A push with touch images: 3 s of it."""
    return simulate_recording(SHAPES["rectangle"], "rectangle-edges", 71, 3.0)


@pytest.mark.parametrize("after", ["gathering", "untouched", "which way images lie", "contact"])
def test_learnt_touch_goes_on(recording, after, tmp_path):
    touched = int(np.argmax(recording.contact))
    at = {"gathering": 5, "untouched": touched - 3, "which way images lie": touched + 8}.get(after, touched + 45)
    tracker = Tracker(recording.shape, recording.sensor, recording.object_pose[0])
    loaded = goes_on(tracker, [recording[k] for k in range(at + 15)], at, tmp_path / "state.npz")
    assert loaded.tactile == "learnt"
    assert tracker.background is None or loaded.background is not None


@pytest.mark.parametrize(
    ("tactile", "smoother"), [("oracle", "fixed-lag"), ("constant", "batch"), ("none", "fixed-lag")]
)
@pytest.mark.parametrize("at", [0, 1, 45, 55, 80])
def test_contacts_and_rests_go_on(tactile, smoother, at, tmp_path):
    """Before the first frame, in the first contact, past its window, between contacts and in the second one."""
    o, e, contact = in_two_contacts("rectangle", 50)
    seen = frames(o, e, contact)[: at + 8]
    tracker = Tracker(SHAPES["rectangle"], sensor(), o[0], settings(tactile, smoother))
    goes_on(tracker, seen, at, tmp_path / "state.npz")


def test_several_answers_go_on(tmp_path):
    o, e = pushed("rectangle", 24)
    rough = Tracker(SHAPES["rectangle"], sensor(), o[0], settings("none"), first_pose_sigma=(0.02, 0.02, 0.2))
    seen = frames(o, e)
    assert len([rough.update(frame) for frame in seen[:10]][-1].answers) > 1
    goes_on(rough, seen, 10, tmp_path / "state.npz", before=10)


def test_a_calibrated_unit_goes_on(tmp_path):
    background = Background(np.full((320, 240, 3), (90, 100, 110), np.float32), np.ones((320, 240, 3), np.float32))
    unit = Calibration(background, CameraView(2, True, (2, 1, 0)), DirectionCorrection(0.02, 0.9, 0.01))
    rng = np.random.default_rng(0)
    seen = [
        Frame(k / 30, np.array([-0.3, 0.0, 0.0]), rng.integers(85, 115, (320, 240, 3), np.uint8)) for k in range(12)
    ]
    tracker = Tracker(SHAPES["disc"], DIGIT, np.zeros(3), TrackerSettings("learnt-pairs"), calibration=unit)
    loaded = goes_on(tracker, seen, 7, tmp_path / "state.npz")
    assert loaded._correction == unit.direction and loaded._gate._view == unit.view
    for one in (tracker, loaded):
        one.reset()
    late = dataclasses.replace(seen[0], contact=None)
    assert tracker.update(late) == loaded.update(late)


def test_isam2_goes_on_between_contacts_and_says_that_it_cannot_in_them(tmp_path):
    o, e, contact = in_two_contacts("disc", 10)
    seen = frames(o, e, contact)
    tracker = Tracker(SHAPES["disc"], sensor(), o[0], settings("none", "isam2"))
    goes_on(tracker, seen[:20], 15, tmp_path / "state.npz")
    before = (tmp_path / "state.npz").read_bytes()
    tracker.update(seen[20])
    tracker.update(seen[21])
    with pytest.raises(SettingError, match=r"state.npz: the tracker cannot be saved now: GTSAM keeps the graph"):
        tracker.save(tmp_path / "state.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["state.npz"]  # the earlier one, whole
    assert (tmp_path / "state.npz").read_bytes() == before


def test_what_tracker_and_stream_call_alike_stays_apart(tmp_path):
    tracker: Any = Tracker(SHAPES["disc"], sensor(), np.zeros(3), settings("none"))
    tracker._alike, tracker._gate._alike = 1.0, 2.0
    tracker.save(tmp_path / "state.npz")
    loaded: Any = Tracker.load(tmp_path / "state.npz")
    assert (loaded._alike, loaded._gate._alike) == (1.0, 2.0)


class Deep(OwnMeasurement):
    on: ClassVar[tuple[str, ...]] = ("depth",)

    def linearise(self, depth: Any) -> Any:
        return (depth - 3e-4) / 1e-4, np.array([[1e4]])


def test_what_cannot_be_saved_is_said(tmp_path):
    o, e = pushed("disc", 4)
    seen = frames(o, e)
    own = Tracker(SHAPES["disc"], sensor(), o[0], settings("none"))
    own.update(dataclasses.replace(seen[0], measurements=(ObjectPose(o[0], 1e-4 * np.eye(3)),)))
    own.save(tmp_path / "state.npz")
    own.update(dataclasses.replace(seen[1], measurements=(Deep(),)))
    with pytest.raises(SettingError, match="no file holds a measurement of your own; save between contacts"):
        own.save(tmp_path / "own.npz")
    drawn = Tracker(SHAPES["disc"], sensor(), o[0], settings("none", "particle-filter"))
    with pytest.raises(SettingError, match="particle filter cannot be saved: what it draws next is in no file"):
        drawn.save(tmp_path / "drawn.npz")
    given = Tracker(SHAPES["disc"], sensor(), o[0], touch=NoTouch())
    with pytest.raises(SettingError, match="touch of your own cannot be saved"):
        given.save(tmp_path / "given.npz")
    with pytest.raises(FileError, match="does not exist"):
        Tracker(SHAPES["disc"], sensor(), o[0]).save(tmp_path / "nowhere" / "state.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["state.npz"]


def test_a_process_that_restarts_goes_on(tmp_path):
    o, e = pushed("rectangle", 20)
    tracker = Tracker(SHAPES["rectangle"], sensor(), o[0], settings("none"))
    seen = frames(o, e)
    for frame in seen[:15]:
        tracker.update(frame)
    tracker.save(tmp_path / "state.npz")
    wanted = [tracker.update(frame) for frame in seen[15:]]
    np.save(tmp_path / "poses.npy", e[15:])
    code = """if True:
        import sys, numpy as np, palpate
        tracker = palpate.Tracker.load(sys.argv[1])
        for k, pose in enumerate(np.load(sys.argv[2]), 15):
            found = tracker.update(palpate.Frame(k / 30, pose, contact=True))
        print(found.pose.tobytes().hex(), found.covariance.tobytes().hex())"""
    words = [sys.executable, "-c", code, str(tmp_path / "state.npz"), str(tmp_path / "poses.npy")]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
    assert said == [wanted[-1].pose.tobytes().hex(), wanted[-1].covariance.tobytes().hex()]


@pytest.fixture
def saved(tmp_path) -> Path:
    Tracker(SHAPES["disc"], sensor(), np.zeros(3), settings("none")).save(tmp_path / "state.npz")
    return tmp_path / "state.npz"


def changed(path: Path, **changes: Any) -> None:
    """Change members of the file's tree."""
    with np.load(path) as file:
        arrays = dict(file)
    tree = {**json.loads(arrays["tree"].tobytes()), **changes}
    np.savez(path, **{**arrays, "tree": np.frombuffer(json.dumps(tree).encode(), np.uint8)})


def test_files_that_are_no_saved_tracker(saved, tmp_path):
    content = saved.read_bytes()
    for cut in (0, 1, len(content) // 2, len(content) - 1):
        saved.write_bytes(content[:cut])
        with pytest.raises(FileError, match=r"state\.npz: "):
            Tracker.load(saved)
    with pytest.raises(FileError, match="no such file"):
        Tracker.load(tmp_path / "none.npz")
    np.savez(saved, tree=np.zeros(3, np.uint8))
    with pytest.raises(FileError, match="is no saved state"):
        Tracker.load(saved)
    write_state(saved, {"format": "cake"}, None, {})
    with pytest.raises(FileError, match="format is 'cake', expected 'palpate-tracker'"):
        Tracker.load(saved)


def test_states_of_other_versions_and_other_code(saved):
    about = StateFile(saved).about
    for changes, words in (
        ({"version": 1}, "version is 1, this palpate reads 9"),
        ({"about": {**about, "palpate": "9.9"}}, "was saved by palpate 9.9, and this is 0"),
        ({"about": {**about, "model_hash": "0"}}, "its touch model is another one now"),
        ({"about": {**about, "shape": {"type": "cube"}}}, "cube"),
        ({"about": 3}, "is no saved tracker"),
        ({"state": {"object": 0}, "objects": [["os", "system", {}]]}, "state that is not of this palpate"),
        ({"state": {"object": 0}, "objects": [["palpate.files", "json", {}]]}, "state that is not of this palpate"),
        ({"state": {"object": 0}, "objects": []}, "state that is not of this palpate"),
    ):
        content = saved.read_bytes()
        changed(saved, **changes)
        with pytest.raises(FileError, match=words) as found:
            Tracker.load(saved)
        assert str(found.value).count("state.npz: ") == 1
        saved.write_bytes(content)
    assert Tracker.load(saved).update(Frame(0.0, np.array([-0.3, 0.0, 0.0]), contact=False)).status == "resting"


def test_plain_values_come_back_as_they_were(tmp_path):
    words = np.array([(1, 2.5, (1.0, 2.0, 3.0))], [("tip", np.int64), ("moved", float), ("pose", float, (3,))])
    shared = np.arange(3.0)
    state = {
        "none": None,
        "numbers": [1.5, np.inf, 0.1],
        "flags": [True, False],
        "mixed": [1, 2.0, "a", (True,)],
        "rows": [(shared, 1), (shared + 1, 2)],
        "arrays": [np.zeros((2, 3)), np.ones((1, 3))],
        "words": words,
        "scalar": np.float32(0.1),
        "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        "shared": [shared, "between", shared],
        "empty": [[], (), {}, np.empty((0, 3))],
    }
    write_state(tmp_path / "a.npz", {}, state, {})
    found = StateFile(tmp_path / "a.npz").state({})
    assert list(found) == list(state)
    for name in ("none", "numbers", "flags", "mixed", "scalar"):
        assert found[name] == state[name] and type(found[name]) is type(state[name])
    assert type(found["mixed"][0]) is int and type(found["mixed"][3]) is tuple
    assert found["words"].dtype == words.dtype and (found["words"] == words).all()
    assert found["fortran"].flags.f_contiguous and (found["fortran"] == state["fortran"]).all()
    assert found["shared"][0] is found["shared"][2] and found["shared"][0].flags.writeable
    np.testing.assert_array_equal(found["arrays"][0], np.zeros((2, 3)))
    np.testing.assert_array_equal(found["rows"][1][0], shared + 1)
    assert found["rows"][1][1] == 2 and found["empty"][:3] == [[], (), {}] and found["empty"][3].shape == (0, 3)


def test_a_tracker_is_saved_right_after_a_reset_and_after_a_brief_contact(recording, tmp_path):
    touched = int(np.argmax(recording.contact))
    tracker = Tracker(recording.shape, recording.sensor, recording.object_pose[0])
    for index in range(touched + 8):  # which way images lie is not settled
        tracker.update(recording[index])
    tracker.reset()
    tracker.save(tmp_path / "state.npz")
    tracker = Tracker(recording.shape, recording.sensor, recording.object_pose[0])
    for index in range(touched):
        tracker.update(recording[index])
    for index in range(touched, touched + 4):
        tracker.update(recording[index], [Deep()])
    for back in range(1, 6):
        tracker.update(dataclasses.replace(recording[touched - back], time=recording.time[touched + 3] + back / 30))
    tracker.save(tmp_path / "state.npz")
