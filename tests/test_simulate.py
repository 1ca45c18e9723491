"""`palpate simulate`: folders of recordings that are reproducible, resumable and whole."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import palpate

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'palpate-lab[sim]'")

SHORT = ("--seconds", "3", "--no-images")
DISC = ("--shape", "disc", *SHORT)
RECORDING = "disc-000000.mcap"


@pytest.fixture
def simulate(run_palpate):
    def run(*words):
        code, out, err = run_palpate("simulate", *words)
        return SimpleNamespace(code=code, out=out, err=err)

    return run


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def contents(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def test_a_recording_with_images(simulate):
    assert simulate("out", "--shape", "disc", "--count", "1", "--seconds", "3", "--ideal").code == 0
    made = palpate.load_recording(f"out/{RECORDING}")
    assert (len(made), made.sensor, made.shape) == (90, palpate.DIGIT, palpate.load_shape("disc"))
    assert made.contact is not None and made.image is not None and made.object_pose is not None
    assert "simulated" in made.source and "seed 0, recording 0," in made.source
    force, depth = made.extra["normal_force"], made.extra["indentation"]
    assert ((force > 0) <= made.contact).all() and (depth[~made.contact] == 0).all()
    # The noise of motion capture: 0.1 mm, 0.1 to 0.2 degrees.
    for noisy, name in ((made.sensor_pose, "sensor_pose_clean"), (made.object_pose, "object_pose_clean")):
        error = noisy - made.extra[name]
        assert error[:, :2].std() == pytest.approx(1e-4, rel=0.25)
        assert np.radians(0.07) < np.angle(np.exp(1j * error[:, 2])).std() < np.radians(0.27)
    # Contact shows in the images.
    free = np.flatnonzero(~made.contact)[:8]
    images = {int(i): np.asarray(made[int(i)].image, float) for i in (*free, depth.argmax())}
    blank = np.mean([images[int(i)] for i in free], axis=0)
    change = {i: float(np.abs(image - blank).max()) for i, image in images.items()}
    assert change.pop(int(depth.argmax())) > 2 * max(change.values())


def test_the_same_options_give_the_same_files(simulate):
    """On one process or two; images and the sensor unit do not change the motion, and knocks not what was before."""
    for name, *options in (["one"], ["two", "--workers", "2"], ["seed", "--seed", "1"], ["unit", "--unit", "5"]):
        assert simulate(name, *DISC, "--count", "2", "--ideal", *options).code == 0
    assert simulate("knocks", *DISC, "--count", "1", "--ideal", "--knocks").code == 0
    assert simulate("images", *DISC[:-1], "--count", "1", "--ideal").code == 0
    assert contents("one") == contents("two")
    assert contents("seed").keys() == {"disc-100000.mcap", "disc-100001.mcap"}
    plain, knocked, seen = (palpate.load_recording(f"{name}/{RECORDING}") for name in ("one", "knocks", "images"))
    assert np.array_equal(plain.sensor_pose, seen.sensor_pose) and seen.image is not None and plain.image is None
    assert all(np.array_equal(value, seen.extra[name], equal_nan=True) for name, value in plain.extra.items())
    flags = knocked.extra["knocked"]
    begin = int(np.argmax(flags))
    assert set(flags) == {0.0, 1.0} and np.array_equal(knocked.sensor_pose[:begin], plain.sensor_pose[:begin])
    units = [palpate.load_recording(path).source.split("of unit ")[1] for path in sorted(Path("unit").iterdir())]
    assert units == ["5", "5"] and "of unit 5" not in plain.source


def test_shards_are_parts_of_the_whole(simulate):
    assert simulate("whole", *DISC, "--count", "3").code == 0
    for part, count in (("1/2", 2), ("2/2", 3)):
        assert simulate("parts", *DISC, "--count", "3", "--shard", part, "--resume").code == 0
        assert len(contents("parts")) == count
    assert contents("parts") == contents("whole")


@pytest.mark.parametrize("name", ["disc", "rectangle", "ellipse", "triangle", "hexagon", "t", "butterfly"])
def test_every_object_is_pushed_and_tracked_by_its_contacts(simulate, name):
    assert simulate("out", "--shape", name, "--count", "3", *SHORT, "--ideal", "--seed", "2").code == 0
    for path in Path("out").iterdir():
        made = palpate.load_recording(path)
        assert made.contact is not None and made.object_pose is not None and made.contact.sum() > 5
        tracker = palpate.Tracker(made.shape, made.sensor, made.object_pose[0], palpate.TrackerSettings("oracle"))
        estimate = [tracker.update(frame) for frame in made][-1]
        # Touch may leave several answers, as at a corner.
        assert min(np.hypot(*(each.pose - made.object_pose[-1])[:2]) for each in estimate.answers) < 0.01


def test_resume_keeps_whole_files_of_the_same_options_and_makes_the_rest(simulate):
    words = ("out", *DISC, "--count", "3")
    assert simulate(*words).code == 0
    whole = contents("out")
    again = simulate(*words)
    assert again.code == 2 and "holds 3 recordings already; --resume" in again.err
    cut, missing, kept = sorted(Path("out").iterdir())
    cut.write_bytes(whole[cut.name][:20000])
    missing.unlink()
    stamp = kept.stat().st_mtime_ns
    done = json.loads(simulate(*words, "--resume", "--json").out)
    assert (done["made"], done["kept"]) == ([cut.name, missing.name], [kept.name])
    assert contents("out") == whole and kept.stat().st_mtime_ns == stamp
    for other in (("--ideal",), ("--knocks",), ("--seconds", "4")):
        refused = simulate(*words, "--resume", *other)
        assert refused.code == 2 and "was made with other options" in refused.err


def test_an_outline_that_cannot_be_pushed_does_not_stop_the_rest(simulate):
    # A gel cannot reach into a star whose points leave no room, and no edge of it is free.
    angle = np.arange(40) * (np.pi / 20)
    star = np.where(np.arange(40) % 2, 0.02, 0.1)[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    np.savetxt("star.csv", star, delimiter=",")
    done = simulate("out", "--shape", "star.csv", *DISC, "--count", "1", "--json")
    found = json.loads(done.out)
    assert done.code == 3 and found["made"] == [RECORDING]
    assert [failed["file"] for failed in found["failed"]] == ["star-edges-000000.mcap"]
    assert "star-edges-000000.mcap: no place was found" in done.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--shape", "cube"), "shape is 'cube'; allowed are disc, rectangle, ellipse"),
        (("--shape", "disc", "--shape", "disc"), "'disc' is given twice"),
        (("--shape", "0.02x0.03"), "the outline is 0.03 m wide; simulation allows 0.05 to 0.5 m"),
        (("--count", "0"), "count is 0; allowed is 1 to 100000"),
        (("--seconds", "nan"), "--seconds: found 'nan'; allowed is a number"),
        (("--seed", "-1"), "seed is -1; allowed is 0 or more"),
        (("--workers", "0"), "workers is 0; allowed is 1 or more"),
        (("--dask", "nowhere"), "no Dask scheduler answers at 'nowhere'"),
        (("--replay", "real.txt", "--knocks", "--ideal"), "its file; no options of pushes can go with it"),
        (("--shard", "3/2"), "--shard is '3/2'; allowed is K/N"),
    ],
)
def test_bad_options_are_one_line_and_leave_nothing(fails, words, said):
    assert said in fails("simulate", "out", *words, *([] if "--replay" in words else ["--no-images"])) and not list(
        Path().glob("out/*")
    )


def test_a_missing_package_and_a_file_for_a_folder_are_named(fails, monkeypatch):
    Path("file").write_text("")
    assert "file: cannot be written" in fails("simulate", "file")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert "[sim]" in fails("simulate", "out") and not Path("out").exists()


def test_an_interrupt_leaves_whole_files_only():
    words = ("simulate", "out", "--shape", "disc", "--count", "200", "--seconds", "3", "--workers", "2")
    process = subprocess.Popen(
        [sys.executable, "-m", "palpate", *words], start_new_session=True, stderr=subprocess.PIPE, text=True
    )
    while len(list(Path().glob("out/*.mcap"))) < 2:
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    files = list(Path("out").iterdir())
    assert 2 <= len(files) < 200 and all(len(palpate.load_recording(path)) == 90 for path in files)


def test_a_replay_of_a_real_recording(simulate):
    time, still = np.arange(40) / 30.0, np.zeros((40, 3))
    pushing = np.column_stack((-0.045 + np.maximum(time - 0.7, 0.0) * 0.02, np.zeros(40), np.zeros(40)))
    moved = np.column_stack((np.maximum(time - 0.7, 0.0) * 0.02, np.zeros(40), np.zeros(40)))
    tip = palpate.SensorProfile("tip", radius=0.005)
    good = palpate.Recording(time, pushing, palpate.Rectangle(0.09, 0.09), tip, moved, contact=time >= 0.7, source="x")
    palpate.write_recording(good, "good.mcap")
    palpate.write_recording(palpate.Recording(time, still, good.shape, tip, still), "mute.mcap")
    Path("words.json").write_text("no recording")
    unreadable = simulate("out", "--replay", "good.mcap", "--replay", "words.json")
    assert unreadable.code == 2 and unreadable.err.startswith("palpate: words.json: ") and not Path("out").exists()
    done = simulate("out", "--replay", "good.mcap", "--replay", "mute.mcap", "--json")
    found = json.loads(done.out)
    assert done.code == 3 and found["made"] == ["good.mcap"]
    assert [failed["file"] for failed in found["failed"]] == ["mute.mcap"]
    assert "palpate: mute.mcap: has no contact flags" in done.err
    made = palpate.load_recording("out/good.mcap")
    assert made.image is not None and made.sensor == palpate.DIGIT and len(made) == 40
    assert made.source.startswith("motion of x; touch rendered by palpate: seed 0, drawn images of unit ")
    again = simulate("out", "--replay", "good.mcap", "--resume")
    assert again.code == 0 and "made none kept good.mcap failed none" in " ".join(again.out.split())
