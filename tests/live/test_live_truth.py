"""Ground truth beside a live session: rendered pictures of an overhead camera, as it gives them and as a video."""

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from live_samples import GEL, SIZE, FakeTracker, state, wait_for
from truth_samples import CAMERA, COUNT, DELAY, PRECISE, ROWS, recording, video, write_video

from palpate import io as formats
from palpate.cli.main import main
from palpate.errors import FileError, SettingError
from palpate.geometry import se2
from palpate.lab.truth import watched
from palpate.lab.truth.camera import save_camera
from palpate.lab.truth.tags import OBJECT, corners_in
from palpate.lab.truth.video import pictures
from palpate.live import camera as camera_room
from palpate.live import overhead as overhead_room
from palpate.live import truth as truth_room
from palpate.live.clock import Clock
from palpate.live.images import TouchImage
from palpate.live.overhead import overhead_truth
from palpate.live.poses import SensorPlace, TimedPose
from palpate.live.session import Sources, track_live
from palpate.live.state import LiveEstimate
from palpate.live.table import table_of
from palpate.live.truth import LiveTruth, Picture, TruePose
from palpate.types.estimate import Estimate
from palpate.types.images import encode_image
from palpate.types.seen_poses import SIGMA

CORNERS: dict[int, Any] = {}


def known_corners(picture: Any, wanted: Any = None) -> Any:
    """The corners in a picture, looked for once only: a busy machine takes too long for that in a running session."""
    key = hash(picture.tobytes())
    if key not in CORNERS:
        CORNERS[key] = corners_in(picture)
    return CORNERS[key]


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    for room in (truth_room, watched):
        monkeypatch.setattr(room, "corners_in", known_corners)


def looked_at(truth: LiveTruth, count: int = COUNT) -> tuple[list[TruePose], list[str]]:
    """What pictures tell while the robot tells where the sensor is: true poses, and what is said."""
    given, _ = recording()
    told: list[Any] = []
    robot = list(zip(given.time, given.sensor_pose, strict=True))
    for when, gray in video()[:count]:
        while robot and robot[0][0] < when + DELAY + 0.05:
            truth.sensor(TimedPose(*robot.pop(0)))
        told += truth.look(Picture(when, gray))
    return [each for each in told if isinstance(each, TruePose)], [each for each in told if isinstance(each, str)]


def errors(time: Any, pose: Any) -> Any:
    """How far poses (N, 3) are off the truth of the samples at times (N,)."""
    given, true = recording()
    columns = [np.interp(time, given.time, values) for values in (*true[:, :2].T, np.unwrap(true[:, 2]))]
    return np.abs(se2.between(np.column_stack(columns), pose))


def test_true_poses_come_as_soon_as_the_table_is_known():
    found, said = looked_at(LiveTruth(lambda _: iter(()), CAMERA))
    assert len(said) == 2 and all("ground truth by" in each for each in said)
    # Six pictures have a hand over the tag, and the first may be before the first pose of the robot; all others tell a
    # pose, those before the table was known as well.
    times = np.array([each.time for each in found])
    seen = np.delete([when for when, _ in video()], np.arange(20, 26))
    assert times == pytest.approx(seen[len(seen) - len(times) :] + DELAY, abs=3e-3) and len(times) >= COUNT - 7
    off, sigma = errors(times, np.array([each.pose for each in found])), np.array([each.sigma for each in found])
    assert (off <= 2.0 * np.array(PRECISE)).all() and (np.median(off, axis=0) <= PRECISE).all()
    assert (off <= 3.0 * sigma).all() and sigma[:, :2].max() < 3e-3


def test_only_what_is_wanted_is_looked_at_closely():
    _, picture = video()[0]
    assert set(corners_in(picture)) >= {0, 1, 10, 11, 12, 13}
    assert set(corners_in(picture, (OBJECT.number,))) == {0}


def test_what_is_learnt_is_kept_after_a_while(monkeypatch):
    monkeypatch.setattr(truth_room, "LAST", 40)
    truth = LiveTruth(lambda _: iter(()), CAMERA)
    found, said = looked_at(truth)
    assert len(said) == 1 and len(found) >= COUNT - 7
    assert len(truth._robot) < 70 and truth._sightings.pictures == 30


def test_what_is_lacking_is_said(monkeypatch):
    monkeypatch.setattr(truth_room, "FIRST", 22)
    given, _ = recording()
    blind = LiveTruth(lambda _: iter(()), CAMERA)
    told = [each for when, gray in video()[:22] for each in blind.look(Picture(when, gray))]
    assert told == ["no ground truth yet: no sensor pose has come"]
    still = LiveTruth(lambda _: iter(()), CAMERA)
    for when in given.time:
        still.sensor(TimedPose(when, given.sensor_pose[0]))
    told = [each for when, gray in video()[:22] for each in still.look(Picture(when, gray))]
    assert len(told) == 1 and "let it turn by 60 or more" in told[0]
    with pytest.raises(FileError, match=r"pictures have \(10, 10\) rows and columns, the camera file is for"):
        next(still.look(Picture(9.0, np.zeros((10, 10), np.uint8))))


class FakeOverhead:
    """An overhead camera and its clock: shows a picture of the video when the one before was looked at, and is lost."""

    def __init__(self) -> None:
        self.shown = -20  # pictures while it settles, and old ones
        self.looked_at: Callable[[], int] = lambda: 0

    def __call__(self, path: Path, size: tuple[int, int]) -> Any:
        assert size == CAMERA.size
        return self

    def now(self) -> float:
        return self.shown / 30.0

    def grab(self) -> bool:
        if self.shown > 0:
            wait_for(lambda: self.looked_at() >= self.shown)
        self.shown += 1
        return self.shown < COUNT

    def image(self) -> Any:
        return cv2.cvtColor(video()[max(self.shown, 0)][1], cv2.COLOR_GRAY2RGB)

    def close(self) -> None:
        pass


def test_a_camera_beside_a_session(tmp_path, monkeypatch):
    fake, given = FakeOverhead(), recording()[0]
    monkeypatch.setattr(camera_room, "_AGAIN", 10.0)
    monkeypatch.setattr(overhead_room, "Clock", lambda start: fake)
    save_camera(CAMERA, tmp_path / "camera.json")
    overhead = overhead_truth("/dev/null", tmp_path / "camera.json", fake)
    fake.looked_at = lambda: overhead._sightings.pictures
    when = given.time - DELAY
    counts, said = state()

    def poses(_):
        yield from (TimedPose(each, pose) for each, pose in zip(when, given.sensor_pose, strict=True))

    def images(_):
        wait_for(lambda: counts.poses == len(when))
        for number, each in enumerate(when[::2]):
            yield TouchImage(each, GEL)
            wait_for(lambda number=number: counts.tracked == number + 1)
        wait_for(lambda: any("lost" in each for each in said))

    heard: list[Any] = []
    track_live(
        FakeTracker(),  # pyright: ignore[reportArgumentType]
        Sources(images, poses, Clock(0.0), SIZE, overhead),
        counts,
        threading.Event(),
        compared=lambda true, estimate: heard.append((true, estimate)),
    )
    assert any("overhead: the camera is lost" in each for each in said)
    assert counts.true_poses == len(heard) > 12
    times = np.array([true.time for true, _ in heard])
    off = errors(DELAY + times, np.array([true.pose for true, _ in heard]))
    assert (off <= 4.0 * np.array(PRECISE)).all()
    compared = [(true, estimate) for true, estimate in heard if estimate is not None]
    assert compared and all(np.array_equal(estimate, np.zeros(3)) for _, estimate in compared)
    told = counts.summary()["truth"]
    assert (told["poses"], told["compared"]) == (len(heard), len(compared))
    away = [1e3 * np.hypot(*true.pose[:2]) for true, _ in compared]
    assert told["error"]["translation_mm"]["max"] == pytest.approx(max(away))
    assert told["error"]["rotation_deg"]["p50"] == pytest.approx(
        np.median([np.degrees(abs(true.pose[2])) for true, _ in compared])
    )


def test_an_estimate_is_compared_with_the_truth_of_its_time():
    counts, _ = state()
    for when, x in ((1.0, 0.1), (1.02, 0.2), (1.5, 0.3)):
        pose = np.array([x, 0.0, np.pi - 0.01 + 10.0 * (when - 1.0)])
        estimate = Estimate(when, pose, np.eye(3), False, "resting")
        counts.estimated(LiveEstimate(estimate, SensorPlace(pose, "known", 0.0), 0.0))

    def true(when: float) -> TruePose:
        return TruePose(when, np.array([0.15, 0.004, -np.pi]), np.zeros(3))

    assert counts.compare(true(0.9)) is None and counts.compare(true(1.6)) is None
    assert counts.compare(true(1.2)) is None  # nobody knows what lies between
    assert counts.error is None
    found = counts.compare(true(1.01))
    assert found == pytest.approx([0.15, 0.0, se2.wrap(np.pi + 0.09)])
    assert counts.error == pytest.approx((4.0, np.degrees(0.09)))
    assert counts.true_poses == 4
    counts.truth_age = 0.05
    assert "the estimate is 4.0 mm, 5.2° off; seen 50 ms ago" in table_of("live", counts).columns[1]._cells


def test_the_command_with_a_video(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(truth_room, "FIRST", 22)
    write_video(Path("push.avi"))
    for _, picture in pictures(Path("push.avi")):
        known_corners(picture)
    save_camera(CAMERA, Path("camera.json"))
    given, true = recording()
    sensor = replace(given.sensor, image_height=40, image_width=30)
    gel = encode_image(np.full((40, 30, 3), 90, np.uint8), "png")
    seen = replace(given, sensor=sensor, image=(gel,) * len(given), codec="png", object_pose=true)
    formats.write(seen, "push.h5")
    words = ["live", "--replay", "push.h5", "--tactile", "none", "--record", "live.mcap"]
    assert main([*words, "--truth", "push.avi", "camera.json"]) == 0
    out, err = capsys.readouterr()
    assert "ground truth by" in err
    assert all(row in out for row in ("true poses, compared", "translation error, median", "rotation error, largest"))
    found: Any = formats.load_recording("live.mcap")
    known = np.isfinite(found.object_pose[:, 0])
    assert known.sum() > 5  # a busy machine leaves out pictures
    assert (errors(found.time[known], found.object_pose[known]) <= 4.0 * np.array(PRECISE)).all()
    assert np.array_equal(np.isfinite(found.extra[SIGMA][:, 0]), known)


@pytest.mark.parametrize(
    ("camera", "file", "said"),
    [
        ("push.avi", "gone.json", "gone.json: no such file"),
        ("push.avi", "wrong.json", "wrong.json: is no camera of palpate truth-camera"),
        ("0000", "camera.json", "camera '0000' is no number, path or serial"),
        ("/dev/null", "camera.json", "camera /dev/null cannot be opened"),
    ],
)
def test_what_cannot_be_a_truth(tmp_path, monkeypatch, capsys, camera, file, said):
    monkeypatch.chdir(tmp_path)
    save_camera(CAMERA, Path("camera.json"))
    Path("wrong.json").write_text("{}")
    Path("push.avi").write_text("no video")
    given, _ = recording()
    formats.write(given, "push.h5")
    assert main(["live", "--replay", "push.h5", "--truth", camera, file]) == 2
    out, err = capsys.readouterr()
    assert out == "" and said in err and err.count("\n") == 1


def test_a_camera_of_another_size_is_refused(tmp_path):
    save_camera(replace(CAMERA, size=(ROWS, 100)), tmp_path / "camera.json")
    fake = FakeOverhead()
    with pytest.raises(SettingError, match=r"camera /dev/null: its pictures have \(720, 960\) rows and columns"):
        overhead_truth("/dev/null", tmp_path / "camera.json", lambda path, size: fake(path, CAMERA.size))
