import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from palpate.cli import main
from palpate.config import TrackerSettings
from palpate.errors import FileError, SettingError
from palpate.geometry import se2
from palpate.geometry.objects import SHAPES
from palpate.geometry.shapes import Disc, Polygon
from palpate.io.recording_mcap import read_recording, write_recording
from palpate.lab.simulate.folder import plan, simulate_folder
from palpate.lab.simulate.objects import find_shape
from palpate.lab.simulate.places import kinds
from palpate.lab.simulate.recordings import simulate_recording
from palpate.parallel import spread
from palpate.pipeline.run import track
from palpate.types.sensor import DIGIT

pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install palpate[sim]")

DISC = SHAPES["disc"]
JOBS = plan({"disc": DISC}, 3)


@pytest.fixture(autouse=True)
def _in_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def palpate(*words):
    try:
        return main.main(["simulate", *words])
    except SystemExit as stop:
        return int(stop.code or 0)


def failure(capsys, *words):
    """Return the one line with which a command fails."""
    assert palpate(*words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("palpate: ") and err.count("\n") == 1
    return err


def contents(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def test_a_recording_with_images():
    done = []
    made = simulate_recording(DISC, "disc", 3, 3.0, progress=done.append, ideal=True)
    assert (len(made), made.sensor, made.shape) == (90, DIGIT, DISC)
    assert done == list(range(1, 91))
    assert made.contact is not None and made.image is not None and made.object_pose is not None
    assert "simulated" in made.source and "seed 0, recording 3," in made.source
    force, depth = made.extra["normal_force"], made.extra["indentation"]
    assert ((force > 0) <= made.contact).all() and (depth[~made.contact] == 0).all()
    # The noise of motion capture: 0.1 mm, 0.1 to 0.2 degrees.
    for noisy, name in ((made.sensor_pose, "sensor_pose_clean"), (made.object_pose, "object_pose_clean")):
        error = se2.wrap(noisy - made.extra[name])
        assert error[:, :2].std() == pytest.approx(1e-4, rel=0.25)
        assert np.radians(0.07) < error[:, 2].std() < np.radians(0.27)
    # Contact shows in the images, and its absence too.
    free = np.flatnonzero(~made.contact)
    pictures = {int(i): np.asarray(made[int(i)].image, float) for i in (*free[:8], depth.argmax())}
    blank = np.mean([pictures[int(i)] for i in free[:8]], axis=0)
    change = {i: float(np.abs(picture - blank).max()) for i, picture in pictures.items()}
    assert change.pop(int(depth.argmax())) > 2 * max(change.values())


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others():
    for name, seed in (("a.mcap", 3), ("b.mcap", 3), ("c.mcap", 4)):
        write_recording(simulate_recording(DISC, "disc", seed, 3.0), name)
    first, again, other = (Path(name).read_bytes() for name in ("a.mcap", "b.mcap", "c.mcap"))
    assert first == again
    assert first != other
    seen, blind = read_recording("a.mcap"), simulate_recording(DISC, "disc", 3, 3.0, images=False)
    assert np.array_equal(seen.sensor_pose, blind.sensor_pose)
    assert seen.extra.keys() == blind.extra.keys()
    for name, values in seen.extra.items():
        assert np.array_equal(values, blind.extra[name], equal_nan=True)
    turned = simulate_recording(SHAPES["ellipse"], "ellipse", 3, 3.0, images=False)
    unit, another = (re.findall("gel of unit ([0-9]+)", made.source) for made in (turned, blind))
    assert len(unit) == len(another) == 1 and unit != another


def test_a_unit_stays_the_same_in_other_recordings():
    disc, ellipse = SHAPES["disc"], SHAPES["ellipse"]
    one = simulate_recording(disc, "disc", 3, 3.0, unit=5, ideal=True)
    other = simulate_recording(ellipse, "ellipse", 4, 3.0, unit=5, ideal=True)
    assert one.source.endswith("of unit 5") and other.source.endswith("of unit 5")
    first, second = (np.asarray(made[0].image, float) for made in (one, other))
    assert np.abs(first - second).mean() < 3.0  # but for noise, the same untouched gel
    alone = np.asarray(simulate_recording(disc, "disc", 3, 3.0)[0].image, float)
    assert np.abs(first - alone).mean() > 6.0


@pytest.mark.parametrize("name", SHAPES)
def test_every_object_is_simulated_in_every_way(name):
    shape = SHAPES[name]
    assert 0.1 < np.ptp(shape.outline(), axis=0).max() < 0.25
    for kind in kinds(shape):
        made = simulate_recording(shape, kind, 0, 3.0, images=False)
        assert made.contact is not None and made.contact.sum() > 5


def test_the_oracle_tracks_a_simulated_push():
    for name, kind in (("disc", "disc"), ("rectangle", "rectangle-corners")):
        run = track(
            simulate_recording(SHAPES[name], kind, 1, 6.0, images=False, ideal=True), TrackerSettings(tactile="oracle")
        )
        assert run.summary["final_translation_error_mm"] < 10.0
        assert run.summary["final_rotation_error_deg"] < 3.0


def test_a_plan_has_every_kind_and_no_seed_of_the_next_plan():
    jobs = plan({"disc": DISC, "box": SHAPES["rectangle"]}, 4, seed=2)
    assert [job.name for job in jobs if job.shape == DISC] == [f"disc-20000{i}.mcap" for i in range(4)]
    assert [job.name for job in jobs if job.shape != DISC] == [
        "box-edges-200000.mcap",
        "box-near-corners-200001.mcap",
        "box-corners-200002.mcap",
        "box-edges-200003.mcap",
    ]
    whole, following = plan({"disc": DISC}, 100_000, seed=2), plan({"disc": DISC}, 1, seed=3)
    assert whole[-1].seed + 1 == following[0].seed


def test_resume_keeps_whole_files_and_makes_the_rest():
    simulate_folder(Path("all"), JOBS, 3.0, images=False)
    simulate_folder(Path("some"), JOBS[:2], 3.0, images=False)
    cut, whole = (Path("some") / job.name for job in JOBS[:2])
    cut.write_bytes(cut.read_bytes()[:20000])
    (Path("some") / f".{JOBS[2].name}.0123abcd.part").write_bytes(b"half")
    stamp = whole.stat().st_mtime_ns
    done = []
    outcome = simulate_folder(Path("some"), JOBS, 3.0, images=False, resume=True, progress=done.append)
    assert outcome.kept == (JOBS[1].name,)
    assert outcome.made == (JOBS[0].name, JOBS[2].name)
    assert done == [2, 3]
    assert whole.stat().st_mtime_ns == stamp
    assert contents("some") == contents("all")
    with pytest.raises(SettingError, match=r"disc-000000\.mcap: was made with other options .*3\.0 s.*4\.0 s"):
        simulate_folder(Path("some"), JOBS, 4.0, images=False, resume=True)


def test_resume_makes_a_damaged_recording_again():
    (job,) = jobs = plan({"disc": DISC}, 1, seed=3)
    simulate_folder(Path("out"), jobs, 3.0)
    file = Path("out") / job.name
    whole = file.read_bytes()
    assert simulate_folder(Path("out"), jobs, 3.0, resume=True).kept == (job.name,)
    recording = read_recording(file)
    assert recording.image is not None
    for data in (recording.image[40], recording.time[40:42].tobytes(), recording.extra["slip"][40:44].tobytes()):
        place = whole.index(data) + len(data) // 2  # a bit flips, and JPEG takes it as it is
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        assert simulate_folder(Path("out"), jobs, 3.0, resume=True).made == (job.name,)
        assert file.read_bytes() == whole


def test_what_cannot_be_made_does_not_stop_the_rest(capsys):
    # A gel cannot reach into a star whose points leave no room, and no edge of it is free.
    angle = np.arange(40) * (np.pi / 20)
    star = np.where(np.arange(40) % 2, 0.02, 0.1)[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    np.savetxt("star.csv", star, delimiter=",")
    words = ("out", "--shape", "star.csv", "--shape", "disc", "--count", "1", "--seconds", "3", "--no-images")
    assert palpate(*words, "--json") == 3
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert found["made"] == ["disc-000000.mcap"]
    assert [failed["file"] for failed in found["failed"]] == ["star-edges-000000.mcap"]
    assert err.count("\n") == 1 and "star-edges-000000.mcap: no place was found" in err


def test_command_line(capsys):
    Path("square.txt").write_text("0 0\n0.1, 0\n0.1 0.1\n0 0.1\n")
    words = ("--shape", "square.txt", "--shape", "disc", "--count", "1", "--seconds", "3", "--no-images", "--ideal")
    assert palpate("out", *words, "--json") == 0
    out, err = capsys.readouterr()
    found = json.loads(out)
    assert err == ""
    assert found["made"] == sorted(contents("out")) == ["disc-000000.mcap", "square-edges-000000.mcap"]
    assert (found["folder"], found["kept"], found["failed"]) == ("out", [], [])
    assert read_recording("out/square-edges-000000.mcap").shape == Polygon([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)])
    assert "holds 2 recordings already; --resume" in failure(capsys, "out", *words)
    assert palpate("out", *words, "--resume") == 0
    assert "0 made, 2 kept, 0 failed" in capsys.readouterr().out
    assert "was made with other options" in failure(capsys, "out", *words[:-1], "--resume")  # with systematic errors


def test_knocks(capsys):
    words = ("--shape", "disc", "--count", "1", "--seconds", "3", "--no-images", "--ideal")
    assert palpate("out", *words, "--knocks") == 0
    made = read_recording("out/disc-000000.mcap")
    knocked = made.extra["knocked"]
    assert set(knocked) == {0.0, 1.0}
    assert made.source.endswith(", knocked") and "knocked" in made.frames["extra"]
    plain = simulate_recording(DISC, "disc", 0, 3.0, images=False, ideal=True)
    assert made.source == f"{plain.source}, knocked" and "knocked" not in plain.extra
    begin = int(np.argmax(knocked))
    assert np.array_equal(made.sensor_pose[:begin, :2], plain.sensor_pose[:begin, :2])
    capsys.readouterr()
    assert palpate("out", *words, "--knocks", "--resume") == 0
    assert "0 made, 1 kept" in capsys.readouterr().out
    assert "was made with other options" in failure(capsys, "out", *words, "--resume")
    assert "--knocks, --ideal cannot go" in failure(
        capsys, "new", "--replay", "out/disc-000000.mcap", "--knocks", "--ideal"
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--shape", "cube"), "shape is 'cube'; allowed are disc, rectangle, ellipse, triangle, hexagon, t, butterfly"),
        (("--shape", "disc", "--shape", "disc"), "'disc' is given twice"),
        (("--shape", "bow.csv"), "bow.csv: polygon outline crosses or touches itself"),
        (
            ("--shape", "big.json"),
            "big.json: the outline is 100 m wide, allowed are 0.005 to 2 m: are these milli",
        ),
        (("--shape", "words.txt"), "words.txt: is no table of numbers"),
        (("--count", "0"), "count is 0; allowed is 1 to 100000"),
        (("--count", "100001"), "count is 100001; allowed is 1 to 100000"),
        (("--seconds", "2.9"), "seconds is 2.9; allowed is 3 to 600"),
        (("--seconds", "nan"), "seconds is nan; allowed is 3 to 600"),
        (("--seed", "-1"), "seed is -1; allowed is 0 or more"),
        (("--workers", "0"), "workers is 0; allowed is 1 or more"),
        (("--dask", "nowhere"), "no Dask scheduler answers at 'nowhere'"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(capsys, words, said):
    Path("bow.csv").write_text("0,0\n0.1,0.1\n0.1,0\n0,0.1\n")
    Path("big.json").write_text('{"vertices": [[0, 0], [100, 0], [0, 100]]}')
    Path("words.txt").write_text("not a polygon\n")
    assert said in failure(capsys, "out", "--no-images", *words)
    assert not list(Path().glob("out/*"))


def test_the_folder_may_be_a_file(capsys):
    Path("out").write_text("")
    assert "out: cannot be a folder of recordings" in failure(capsys, "out")
    with pytest.raises(FileError):
        simulate_folder(Path("out") / "in", JOBS, 3.0)


def test_missing_packages_are_named(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert "MuJoCo, which is not installed: pip install palpate[sim]" in failure(capsys, "out")
    assert not Path("out").exists()
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SettingError, match=r"distributed, which is not installed: pip install palpate\[cluster\]"):
        list(spread(abs, [1], dask="tcp://localhost:1"))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_full_disk_is_one_line_and_leaves_whole_files(workers):
    resource = pytest.importorskip("resource", reason="no limits on this system")
    words = ("simulate", "out", "--shape", "disc", "--count", "3", "--seconds", "3", "--workers", str(workers))
    command = [sys.executable, "-m", "palpate.cli.main", *words]

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))

    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=limit, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("palpate: out/disc-00000") and "cannot be written" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not Path("out").exists()


def test_json_of_vertices(tmp_path):
    (tmp_path / "tri.json").write_text('{"vertices": [[0, 0], [0.1, 0], [0, 0.1]]}')
    assert find_shape(str(tmp_path / "tri.json")) == ("tri", Polygon([(0, 0), (0.1, 0), (0, 0.1)]))
    assert find_shape("disc") == ("disc", Disc(0.088))


def test_two_workers_make_what_one_makes():
    simulate_folder(Path("one"), JOBS[:2], 3.0, images=False)
    simulate_folder(Path("two"), JOBS[:2], 3.0, images=False, workers=2)
    assert contents("one") == contents("two")


def test_an_interrupt_leaves_whole_files_only():
    words = ("simulate", "out", "--shape", "disc", "--count", "200", "--seconds", "3", "--workers", "2")
    environment = os.environ | {"PYTHONWARNINGS": "error"}
    command = [sys.executable, "-m", "palpate.cli.main", *words]
    process = subprocess.Popen(command, start_new_session=True, stderr=subprocess.PIPE, env=environment, text=True)
    until = time.monotonic() + 60
    while len(list(Path().glob("out/*.mcap"))) < 2 and time.monotonic() < until:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    names = contents("out")
    assert 2 <= len(names) < 200 and all(name.endswith(".mcap") for name in names)
    assert all(len(read_recording(Path("out") / name)) == 90 for name in names)


def test_a_dask_cluster_of_two_workers_makes_what_one_process_makes():
    distributed = pytest.importorskip("distributed", reason="no distributed: pip install palpate[cluster]")
    simulate_folder(Path("here"), JOBS, 3.0, images=False)
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": "127.0.0.1:0"}
    with distributed.LocalCluster(**options) as cluster:
        simulate_folder(Path("there"), JOBS, 3.0, images=False, dask=cluster.scheduler_address)
        assert os.getpid() not in set(spread(lambda _: os.getpid(), range(4), dask=cluster.scheduler_address))
    assert contents("here") == contents("there")
