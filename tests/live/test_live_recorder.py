import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from live_samples import GEL
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from view_samples import CAMERA

from palpate import io as formats
from palpate.geometry.shapes import Disc
from palpate.io.rosbag_reader import bag_messages
from palpate.live.poses import SensorPlace, TimedPose
from palpate.live.recorder import recorder
from palpate.live.session import LiveEstimate
from palpate.live.sources import TouchImage
from palpate.types.estimate import Answer, Estimate
from palpate.types.images import decode_image

KILLED = """
import sys, time
sys.path.insert(0, {tests!r})
import numpy as np
from pathlib import Path
from live_samples import GEL
from view_samples import CAMERA
from palpate.geometry.shapes import Disc
from palpate.live.sources import TouchImage
from palpate.live.poses import TimedPose
from palpate.live.recorder import recorder

with recorder(Path("killed.mcap"), Disc(0.05), CAMERA) as taking:
    begin = time.monotonic()
    while True:
        now = time.monotonic() - begin
        taking.pose(TimedPose(now, np.array([0.1, 0.2, 0.3])))
        taking.image(TouchImage(now, GEL, "png"))
        print(now, flush=True)
        time.sleep(0.01)
"""


def test_a_kill_loses_at_most_the_last_second(tmp_path, caplog):
    script = KILLED.format(tests=str(Path(__file__).resolve().parents[1]))
    process = subprocess.Popen([sys.executable, "-c", script], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
    assert process.stdout
    times = [float(process.stdout.readline())]
    while times[-1] < 1.5:
        times.append(float(process.stdout.readline()))
    process.kill()
    process.communicate()
    recording = formats.load_recording(tmp_path / "killed.mcap")
    assert recording.time[-1] > times[-1] - 1.0 and recording.shape == Disc(0.05)
    assert "is cut off or damaged" in caplog.text


def test_what_is_recorded_is_a_recording(tmp_path):
    path = tmp_path / "live.mcap"
    with recorder(path, Disc(0.05), CAMERA) as taking:
        for index in range(4):
            when = index / 30
            pose = np.array([0.1 * index, -0.2, 3.0])
            taking.pose(TimedPose(when, pose))
            taking.image(TouchImage(when, GEL + np.uint8(index), "png"))
            estimate = Estimate(when, pose, np.eye(3), True, "displaced", "it is gone")
            taking.estimate(LiveEstimate(estimate, SensorPlace(pose, "held", 0.05), 0.004))
    taking.image(TouchImage(9.0, GEL))  # too late, and left out
    recording = formats.load_recording(path)
    assert (recording.shape, recording.sensor, recording.codec) == (Disc(0.05), CAMERA, "png")
    assert np.allclose(recording.time, np.arange(4) / 30, atol=1e-9)
    assert np.allclose(recording.sensor_pose, [[0.1 * index, -0.2, 3.0] for index in range(4)], atol=1e-12)
    assert recording.image is not None
    for index, data in enumerate(recording.image):
        assert np.array_equal(decode_image(data, "png", GEL.shape[:2]), GEL + np.uint8(index))
    diagnosis = next(raw for raw in bag_messages(path) if raw.channel.topic == "/palpate/diagnostics").data
    for words in (b"displaced", b"it is gone", b"held", b"sensor pose age [ms]", b"50.0", b"4.0"):
        assert words in diagnosis


def test_all_answers_are_recorded(tmp_path):
    """Of an ambiguous estimate, as another program decodes them, and of a sure one, which is its own only answer."""
    path, covariance = tmp_path / "live.mcap", np.diag([4e-6, 9e-6, 1e-4])
    poses = np.array([[0.1, 0.2, 0.0], [0.1, 0.24, np.pi / 2], [-0.3, 0.0, np.pi]])
    weights = 0.6, 0.3, 0.1
    several = tuple(Answer(pose, covariance * (n + 1) ** 2, weights[n]) for n, pose in enumerate(poses))
    ambiguous = Estimate(1.0, poses[0], np.eye(3), True, "ambiguous", "3 poses", several)
    sure = Estimate(1.5, poses[1], covariance, True, "tracking", "", (Answer(poses[1], covariance, 1.0),))
    with recorder(path, Disc(0.05), CAMERA) as taking:
        for estimate in (ambiguous, sure):
            taking.estimate(LiveEstimate(estimate, SensorPlace(np.zeros(3), "known", 0.0), 0.004))
    told: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for _, channel, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            told.setdefault(channel.topic, []).append(message)
    arrays, diagnoses = told["/palpate/object_pose_answers"], told["/palpate/diagnostics"]
    for messages in (arrays, diagnoses):
        headers = [(one.header.stamp.sec, one.header.stamp.nanosec, one.header.frame_id) for one in messages]
        assert headers == [(1, 0, "world"), (1, 500_000_000, "world")]
    found = [[(p.position.x, p.position.y, p.orientation.z, p.orientation.w) for p in one.poses] for one in arrays]
    half = np.sqrt(0.5)
    assert np.allclose(found[0], [(0.1, 0.2, 0.0, 1.0), (0.1, 0.24, half, half), (-0.3, 0.0, 1.0, 0.0)])
    assert np.allclose(found[1], [(0.1, 0.24, half, half)])
    words = [{each.key: each.value for each in one.status[0].values} for one in diagnoses]
    assert [one["answer weights"] for one in words] == ["0.6000 0.3000 0.1000", "1.0000"]
    assert [one["answer sigmas x [mm]"] for one in words] == ["2.00 4.00 6.00", "2.00"]
    assert [one["answer sigmas y [mm]"] for one in words] == ["3.00 6.00 9.00", "3.00"]
    assert [one["answer sigmas yaw [deg]"] for one in words] == ["0.57 1.15 1.72", "0.57"]
