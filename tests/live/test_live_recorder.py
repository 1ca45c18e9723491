import re
import subprocess
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
from live_samples import GEL
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from view_samples import CAMERA

from palpate import io as formats
from palpate.geometry.shapes import Disc
from palpate.io.bags.containers import raw_messages
from palpate.io.bags.raw import CutShort
from palpate.live.poses import SensorPlace, TimedPose
from palpate.live.recorder import recorder
from palpate.live.session import LiveEstimate
from palpate.live.sources import TouchImage
from palpate.types.answer import Answer
from palpate.types.estimate import Estimate
from palpate.types.images import decode_image

KILLED = """
import os, random, signal, sys, time
sys.path.insert(0, {tests!r})
import numpy as np
from pathlib import Path
from live_samples import GEL
from view_samples import CAMERA
from palpate.geometry.shapes import Disc
from palpate.live.sources import TouchImage
from palpate.live.poses import SensorPlace, TimedPose
from palpate.live.recorder import recorder
from palpate.live.session import LiveEstimate
from palpate.types.estimate import Estimate

random.seed(7)
with recorder(Path("warm.mcap"), Disc(0.05), CAMERA):
    pass
for number in range(20):
    ours, its = os.pipe()
    child = os.fork()
    if not child:
        image = np.random.default_rng(number).integers(0, 256, GEL.shape, np.uint8)
        with recorder(Path(f"{{number}}.mcap"), Disc(0.05), CAMERA) as taking:
            for index in range(10**6):
                when, pose = 5.0 + index / 30, np.array([0.1, 0.2, 0.3])
                taking.image(TouchImage(when, image, "png"))
                os.write(its, b"1")
                taking.pose(TimedPose(when, pose))
                os.write(its, b"1")
                estimate = Estimate(when, pose, np.eye(3), False, "resting")
                taking.estimate(LiveEstimate(estimate, SensorPlace(pose, "known", 0.0), 0.0))
                os.write(its, b"4")
    os.close(its)
    os.read(ours, 1)
    time.sleep(random.uniform(0.0, 0.05))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    with os.fdopen(ours, "rb") as pipe:
        print(number, 1 + sum(int(chr(each)) for each in pipe.read()), flush=True)
"""


def test_a_kill_loses_at_most_what_is_being_written(tmp_path):
    """Twenty processes are killed; each told after each write that it was done."""
    script = KILLED.format(tests=str(Path(__file__).resolve().parents[1]))
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 0, done.stderr
    told = {int(number): int(count) for number, count in re.findall(r"^(\d+) (\d+)$", done.stdout, re.MULTILINE)}
    assert len(told) == 20 and max(told.values()) > 10
    for number, count in told.items():
        found = 0
        try:
            for _ in raw_messages(tmp_path / f"{number}.mcap"):
                found += 1
        except CutShort:
            pass
        assert count <= found <= count + 4
    recording = formats.load_recording(tmp_path / "0.mcap")
    assert recording.shape == Disc(0.05) and np.all(recording.sensor_pose == recording.sensor_pose[0])


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
    diagnosis = next(raw for raw in raw_messages(path) if raw.channel.topic == "/palpate/diagnostics").data
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


def test_recording_for_long_keeps_nothing_in_memory(tmp_path):
    image = TouchImage(0.0, b"image", "jpeg")
    with recorder(tmp_path / "long.mcap", Disc(0.05), CAMERA) as taking:
        for number in range(-10, 1000):
            if number == 0:
                tracemalloc.start()
            taking.image(image._replace(time=10.0 + number))
        kept, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert kept < 100 * 1000  # an index in memory takes 900 bytes an image
    with (tmp_path / "long.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None and len(summary.chunk_indexes) == 1010
        assert sum(1 for _ in make_reader(file).iter_messages()) == 1010
