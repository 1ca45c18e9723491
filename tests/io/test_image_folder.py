"""A folder of images with a table of poses becomes a recording by `palpate convert`."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from bag_samples import touch_images
from planar import wrap
from recording_samples import encoded
from scipy.spatial.transform import Rotation

import palpate
from palpate.io.pose_tables import read_pose_table
from palpate.types.choices import TableChoices

COUNT = 12
START = 1_700_000_000  # [s]
IMAGE_TIME = 0.1 + np.arange(COUNT) / 30
POSE_TIME = np.arange(80) / 100


def true_pose(time):
    """Straight on and turning, (N, 3); linear, so that it is the same where it is interpolated."""
    return np.column_stack([0.4 + 0.05 * time, -0.1 * time, 0.3 + 0.8 * time])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the images img/frame_0.png to frame_11.png."""
    monkeypatch.chdir(tmp_path)
    Path("img").mkdir()
    for number, image in enumerate(touch_images(COUNT)):
        Path(f"img/frame_{number}.png").write_bytes(encoded(image))
    return tmp_path


def write_table(name, header, rows, separator=","):
    lines = [separator.join(str(cell) for cell in row) for row in rows]
    Path(name).write_text("\n".join([*([header] if header else []), *lines]) + "\n")


def image_table(name="t.csv", header="time,file", scale=1.0):
    rows = [(repr(float((START + time) * scale)), f"frame_{k}.png") for k, time in enumerate(IMAGE_TIME)]
    write_table(name, header, rows)
    return name


def quaternions(poses):
    return Rotation.from_euler("z", poses[:, 2:]).as_quat()


def seven(order="xyzw", unit=1.0):
    poses = true_pose(POSE_TIME)
    quaternion = quaternions(poses)[:, ["xyzw".index(letter) for letter in order]]
    return np.column_stack([unit * poses[:, :2], np.full(len(poses), 0.3 * unit), quaternion])


def matrices(by_columns):
    given = np.tile(np.eye(4), (len(POSE_TIME), 1, 1))
    poses = true_pose(POSE_TIME)
    given[:, :3, :3] = Rotation.from_euler("z", poses[:, 2:]).as_matrix()
    given[:, :2, 3] = poses[:, :2]
    given[:, 2, 3] = 0.3
    return (given.transpose(0, 2, 1) if by_columns else given).reshape(-1, 16)


def with_times(poses, scale=1e9):
    return [(int((START + time) * scale), *map(repr, row.tolist())) for time, row in zip(POSE_TIME, poses, strict=True)]


def convert(run_palpate, *words):
    """Convert the folder with these options; return the recording."""
    code, _, err = run_palpate("convert", "--images", "img", "--shape", "0.09x0.06", "push.mcap", "--force", *words)
    assert code == 0, err
    return palpate.load_recording("push.mcap")


def same_push(recording, start=START):
    assert np.abs(recording.time - start - IMAGE_TIME).max() < 2e-6
    poses = true_pose(IMAGE_TIME)
    assert np.abs(recording.sensor_pose[:, :2] - poses[:, :2]).max() < 2e-6
    assert np.abs(wrap(recording.sensor_pose[:, 2] - poses[:, 2])).max() < 2e-6


IN_DEGREES = true_pose(POSE_TIME) * [1.0, 1.0, np.degrees(1.0)]
TABLES = {
    "libfranka": (",".join(["time", *(f"O_T_EE[{k}]" for k in range(16))]), with_times(matrices(by_columns=True))),
    "by rows": ("", with_times(matrices(by_columns=False))),
    "tum": ("# timestamp tx ty tz qx qy qz qw", with_times(seven(), 1e6)),
    "w first by name": ("stamp_ms,qw,qx,qy,qz,x,y,z", with_times(np.roll(seven("wxyz"), -3, axis=1), 1e3)),
    "rostopic": (
        "%time,field.header.stamp,field.header.frame_id,"
        + ",".join(f"field.pose.position.{k}" for k in "xyz")
        + ","
        + ",".join(f"field.pose.orientation.{k}" for k in "xyzw"),
        [(5, row[0], "base", *row[1:]) for row in with_times(seven())],
    ),
    "degrees": (
        "Time (us),X [mm],Y [mm],Yaw [deg]",
        with_times(true_pose(POSE_TIME) * [1e3, 1e3, np.degrees(1.0)], 1e6),
    ),
    "planar": ("", with_times(true_pose(POSE_TIME), 1e3)),
    "signs of units": ("t [\N{MICRO SIGN}s],x,y,yaw [\N{DEGREE SIGN}]", with_times(IN_DEGREES, 1e6)),
    "pandas": (",time,x,y,theta", [(k, *row) for k, row in enumerate(with_times(true_pose(POSE_TIME)))]),
    "commas at the end": ("time,x,y,theta,", [(*row, "") for row in with_times(true_pose(POSE_TIME))]),
    "euroc": (
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []",
        with_times(seven("wxyz")),
    ),
    "two columns of a stamp": (
        "Time,header.stamp.secs,header.stamp.nsecs,x,y,theta",
        [(5, row[0] // 10**9, row[0] % 10**9, *row[1:]) for row in with_times(true_pose(POSE_TIME))],
    ),
    "no number in some cells": (
        "time,x,y,theta",
        [
            row if k % 5 or k > 9 else (row[0], "NULL", "n/a", "")
            for k, row in enumerate(with_times(true_pose(POSE_TIME)))
        ],
    ),
    "one time that is none": (
        "time,x,y,theta",
        [("nan" if k == 79 else row[0], *row[1:]) for k, row in enumerate(with_times(true_pose(POSE_TIME)))],
    ),
    "one time of 0": (
        "time,x,y,theta",
        [(0 if k == 79 else row[0], *row[1:]) for k, row in enumerate(with_times(true_pose(POSE_TIME)))],
    ),
    "one matrix of zeros": (
        "",
        [
            (row[0], *([0.0] * 16 if k == 79 else row[1:]))
            for k, row in enumerate(with_times(matrices(by_columns=True)))
        ],
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_poses_as_people_have_them(folder, run_palpate, name):
    header, rows = TABLES[name]
    write_table("ee.csv", header, rows, " " if name == "tum" else ",")
    same_push(convert(run_palpate, "--image-times", image_table(), "--poses", "ee.csv"))


@pytest.mark.parametrize(("header", "scale"), [("time_ms,file", 1e3), ("", 1e3), ("#timestamp [ns],filename", 1e9)])
def test_times_of_images_in_other_units(folder, run_palpate, header, scale):
    write_table("ee.csv", "", with_times(seven()))
    same_push(convert(run_palpate, "--image-times", image_table(header=header, scale=scale), "--poses", "ee.csv"))


def test_files_go_into_the_recording_as_they_are(folder, run_palpate):
    write_table("ee.csv", "", with_times(seven()))
    recording = convert(run_palpate, "--image-times", image_table(), "--poses", "ee.csv")
    assert list(recording.image or ()) == [Path(f"img/frame_{k}.png").read_bytes() for k in range(COUNT)]
    turned = convert(run_palpate, "--image-times", image_table(), "--poses", "ee.csv", "--orientation", "180,bgr")
    for frame, image in zip(turned, touch_images(COUNT), strict=True):
        assert (frame.image == image[::-1, ::-1, ::-1]).all()


@pytest.mark.parametrize("scale", [1.0, 1e6])
def test_times_in_the_names_of_files(folder, run_palpate, scale):
    for number, time in enumerate(IMAGE_TIME):
        name = f"{START + time:.6f}" if scale == 1.0 else f"left_{int((START + time) * scale)}"
        Path(f"img/frame_{number}.png").rename(f"img/{name}.png")
    write_table("ee.csv", "", with_times(seven()))
    same_push(convert(run_palpate, "--poses", "ee.csv"))


def test_times_in_names_have_as_many_decimals_as_python_writes(folder, run_palpate):
    whole = START + np.floor(1e4 * IMAGE_TIME) / 1e4
    for number, time in enumerate(whole.tolist()):
        Path(f"img/frame_{number}.png").rename(f"img/{time!r}.png")  # 1700000000.3 after 1700000000.2666
    write_table("ee.csv", "", with_times(seven()))
    recording = convert(run_palpate, "--poses", "ee.csv")
    assert np.abs(recording.time - whole).max() < 1e-6
    assert [np.asarray(frame.image)[0, 0, 0] for frame in recording] == touch_images(COUNT)[:, 0, 0, 0].tolist()


@pytest.mark.parametrize("begin", ["run_1", "1700000000100000000"])
def test_names_that_are_counted_are_no_times(folder, fails, begin):
    for number in range(COUNT):
        Path(f"img/frame_{number}.png").rename(f"img/{begin}_{number:06d}.png")
    write_table("ee.csv", "", with_times(seven(), 1e3))
    assert "--rate" in refused(fails, "--poses", "ee.csv", "--time-unit", "ms")


@pytest.mark.parametrize("step", [1, 10])
def test_a_rate_in_place_of_times_and_names_that_are_missing(folder, run_palpate, caplog, step):
    Path("img/frame_3.png").unlink()
    for number in (number for number in range(COUNT - 1, 0, -1) if number != 3):
        Path(f"img/frame_{number}.png").rename(f"img/frame_{step * number}.png")
    write_table("ee.csv", "", with_times(seven()))
    code, _, _ = run_palpate(
        *("convert", "img", "push.mcap", "--poses", "ee.csv", "--rate", 30, "--time-offset", 0.1, "--shape", "disc")
    )
    assert code == 0 and "first pose" in caplog.text
    recording = palpate.load_recording("push.mcap")
    assert np.abs(recording.time - START - np.delete(IMAGE_TIME, 3)).max() < 2e-6


def test_files_that_would_shift_the_others_are_named(folder, fails):
    write_table("ee.csv", "", with_times(seven()))
    for name in ("calib.png", "frame_3.jpg"):
        Path("img", name).write_bytes(Path("img/frame_3.png").read_bytes())
        assert Path(name).stem in refused(fails, "--poses", "ee.csv", "--rate", 30)
        Path("img", name).unlink()


def test_images_of_two_cameras_in_a_folder_are_named(folder, fails):
    for number, image in enumerate(touch_images(COUNT)):
        Path(f"img/mask_{number}.png").write_bytes(encoded(image))
    write_table("ee.csv", "x,y,theta", true_pose(np.arange(2 * COUNT) / 30).tolist())
    write_table("t.csv", "time", [(START + k / 30,) for k in range(2 * COUNT)])
    for options in (("--rate", 30), ("--image-times", "t.csv")):
        message = refused(fails, "--poses", "ee.csv", *options)
        assert "mask_0.png is named unlike 12 of the 24 images, such as frame_0.png" in message
    write_table("ee.csv", "time,x,y,theta", with_times(true_pose(POSE_TIME))[: 2 * COUNT])
    assert "mask_0.png" in refused(fails, "--poses", "ee.csv")


def test_images_that_are_there_as_png_and_as_jpeg_are_named(folder, fails):
    write_table("ee.csv", "", with_times(seven()))
    for number in range(COUNT):
        image = Path(f"img/frame_{number}.png")
        image.rename(f"img/{START + number}000000000.png").with_suffix(".jpg").write_bytes(encoded(touch_images(1)[0]))
    assert f"holds {START}000000000 with two suffixes" in refused(fails, "--poses", "ee.csv")


def test_times_in_names_that_go_back_are_named(folder, fails):
    for number in range(COUNT):
        Path(f"img/frame_{number}.png").rename(f"img/12-{number // 6:02d}-{(59.8 + number / 30) % 60:06.3f}.png")
    write_table("ee.csv", "x,y,theta", true_pose(IMAGE_TIME).tolist())
    assert "go back" in refused(fails, "--poses", "ee.csv")


def test_paths_of_another_system_are_found(folder, run_palpate):
    write_table("ee.csv", "", with_times(seven()))
    table = Path(image_table())
    table.write_text(table.read_text().replace("frame_", "C:\\data\\frame_"))
    same_push(convert(run_palpate, "--image-times", table, "--poses", "ee.csv"))


def test_a_pose_for_each_image(folder, run_palpate):
    write_table("ee.csv", "x,y,theta", true_pose(IMAGE_TIME).tolist())
    same_push(convert(run_palpate, "--image-times", image_table(), "--poses", "ee.csv"))


@pytest.mark.parametrize("name", ["ts", "timestamps", "datetime", "log_ts_ns"])
def test_a_pose_for_each_image_has_a_time_of_its_own(folder, run_palpate, name):
    """As many poses as images, which were recorded 30 ms later."""
    time = IMAGE_TIME - 0.03
    rows = [(int((START + each) * 1e9), *pose) for each, pose in zip(time, true_pose(time).tolist(), strict=True)]
    write_table("ee.csv", f"{name},x,y,theta", rows)
    recording = convert(run_palpate, "--image-times", image_table(), "--poses", "ee.csv")
    assert np.abs(recording.sensor_pose - true_pose(IMAGE_TIME[: len(recording)])).max() < 2e-6


def test_a_column_that_counts_is_no_time(folder, run_palpate):
    poses = [(number, 2 * number, *pose) for number, pose in enumerate(true_pose(IMAGE_TIME).tolist())]
    write_table("ee.csv", "row,frame,x,y,theta", poses)
    same_push(convert(run_palpate, "--image-times", image_table(), "--poses", "ee.csv"))


def test_true_poses_in_a_table(folder, run_palpate):
    write_table("ee.csv", "", with_times(seven()))
    write_table("object.csv", "time,x,y,theta", with_times(true_pose(POSE_TIME) + np.array([1.0, 0.0, 0.0])))
    options = ("--image-times", image_table(), "--poses", "ee.csv", "--object-poses", "object.csv")
    recording = convert(run_palpate, *options)
    assert np.abs(recording.truth[:, 0] - true_pose(IMAGE_TIME)[:, 0] - 1.0).max() < 2e-6


def refused(fails, *words):
    message = fails("convert", "--images", "img", "--shape", "0.09x0.06", "push.mcap", *words)
    assert not Path("push.mcap").exists()
    return message


def test_what_nothing_tells_is_asked(folder, fails):
    write_table("ee.csv", "", with_times(seven(unit=1e3)))
    times = ("--image-times", image_table())
    assert "millimetres" in refused(fails, *times, "--poses", "ee.csv")
    write_table("ee.csv", "", with_times(seven("wxyz")))
    assert "--quaternion" in refused(fails, *times, "--poses", "ee.csv")
    write_table("ee.csv", "", [(k, *row) for k, row in enumerate(true_pose(POSE_TIME).tolist())])
    assert "--time-unit" in refused(fails, *times, "--poses", "ee.csv")
    write_table("ee.csv", "", with_times(seven()))
    assert "--rate" in refused(fails, "--poses", "ee.csv")


def test_answers_to_these_questions(folder, run_palpate):
    write_table("ee.csv", "", with_times(seven("wxyz", 1e3)))
    options = ("--image-times", image_table(), "--poses", "ee.csv", "--poses-unit", "mm", "--quaternion", "wxyz")
    same_push(convert(run_palpate, *options))


BAD = {
    "a word": ("time,x,y,theta", [(0.0, 0.1, 0.1, 0.1), (0.1, "fast", 0.1, 0.1)], "line 3"),
    "other columns": ("time,j1,j2,j3", [(0.0, 0.1, 0.1, 0.1)], "time, j1, j2, j3"),
    "two positions": ("time,a_x,a_y,b_x,b_y,yaw", [(0.0,) * 6], "a_x"),
    "five numbers": ("", [(0.0,) * 5], "5 columns"),
    "degrees": ("time,x,y,yaw", [(START + k / 100, 0.1, 0.1, 90.0 + k) for k in range(9)], "theta_deg"),
    "no matrix": ("", [(START + k / 100, *range(16)) for k in range(9)], "line 1"),
    "a short row": ("time,x,y,theta", [(0.0, 0.1, 0.1, 0.1), (0.1, 0.1)], "line 3"),
    "a day as Excel writes it": (
        "time,x,y,theta",
        [(f"11/29/2026 8:15:{k}", 0.1, 0.1, 0.1) for k in range(10, 19)],
        "expected a number or a time such as 2026-",
    ),
    "several rows of names, as Motive has them": (
        "Format Version,1.2,Take Name,a,Export Frame Rate,120.000,Rotation Type,Quaternion,Length Units,Meters\n"
        ",,Name,digit,digit,digit\n,,,Position,Position,Position\nFrame,Time (Seconds),X,Y,Z,X",
        [(k, k / 120, 0.1, 0.1, 0.1, 0.0) for k in range(9)],
        "line 2: found 6 columns below 10, and 6 in the last row: the export of a motion capture",
    ),
    "no rows": ("time,x,y,theta", [], "no rows"),
    "two units": ("time,x_mm,y_m,theta", with_times(true_pose(POSE_TIME)), "x_mm, y_m"),
    "a tool that points down": (
        "time,x,y,z,roll,pitch,yaw",
        [(START + k / 100, 0.1, 0.1, 0.3, np.pi, 0.0, 0.1) for k in range(9)],
        "roll reaches 180 degrees",
    ),
    "minutes": ("time (min),x,y,theta", with_times(true_pose(POSE_TIME)), "time_min"),
    "times of an unknown name": ("epoch,x,y,theta", with_times(true_pose(POSE_TIME)), "epoch' rises from row to row"),
    "names of other columns": ("time,x,y", with_times(true_pose(POSE_TIME)), "4 columns below the 3 names"),
}


@pytest.mark.parametrize("name", BAD)
def test_tables_that_cannot_be_read_are_named(folder, fails, name):
    header, rows, words = BAD[name]
    write_table("ee.csv", header, rows)
    message = refused(fails, "--image-times", image_table(), "--poses", "ee.csv")
    assert "ee.csv" in message and words in message


@pytest.mark.parametrize(("name", "good"), [("tracking_valid", "True"), ("is_tracked", 1), ("occluded", "false")])
def test_poses_that_a_column_flags_as_lost_are_unknown(folder, run_palpate, caplog, name, good):
    bad = {"True": "False", 1: 0, "false": "true"}[good]
    rows = with_times(true_pose(POSE_TIME))
    frozen = [
        (*(row[:1] + rows[20][1:] if 20 <= k < 50 else row), bad if 20 <= k < 50 else good)
        for k, row in enumerate(rows)
    ]
    write_table("ee.csv", f"time,x,y,theta,{name}", frozen)
    recording = convert(run_palpate, "--image-times", image_table(), "--poses", "ee.csv")
    seen = (IMAGE_TIME < 0.19) | (IMAGE_TIME > 0.5)
    assert np.abs(recording.time - START - IMAGE_TIME[seen]).max() < 2e-6
    assert np.abs(recording.sensor_pose[:, :2] - true_pose(IMAGE_TIME[seen])[:, :2]).max() < 2e-6
    assert f"30 of 80 poses are unknown by column {name}" in caplog.text


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [("valid", "1.000000e+00", "0.000000e+00"), ("valid", 1, ""), ("tracked", "yes", "no"), ("not_visible", 0, 1)],
)
def test_flags_as_programs_write_them(tmp_path, name, good, bad):
    rows = [(START + k / 50, 0.4 + k / 1000, 0, 0, bad if 5 <= k < 8 else good) for k in range(40)]
    write_table(tmp_path / "ee.csv", f"time,x,y,theta,{name}", rows)
    unknown = np.isnan(read_pose_table(tmp_path / "ee.csv", TableChoices()).poses).any(axis=1)
    assert np.flatnonzero(unknown).tolist() == [5, 6, 7]


def test_a_column_of_flags_that_are_none_is_warned_of(tmp_path, caplog):
    rows = [(START + k / 50, 0.4 + k / 1000, 0, 0, "poor") for k in range(40)]
    write_table(tmp_path / "ee.csv", "time,x,y,theta,valid", rows)
    assert np.isfinite(read_pose_table(tmp_path / "ee.csv", TableChoices()).poses).all()
    assert "column valid is not used: found 'poor'" in caplog.text


def test_rows_that_are_there_twice_count_once_also_where_poses_are_unknown(tmp_path):
    rows = [(START + k / 50, 0.4 + k / 1000, 0, 0, int(not 5 <= k < 8)) for k in range(40)]
    write_table(tmp_path / "ee.csv", "time,x,y,theta,valid", [*rows, *rows])
    assert len(read_pose_table(tmp_path / "ee.csv", TableChoices()).poses) == 40


@pytest.mark.parametrize("name", ["cam{camera}_{k:04d}", "{k:04d}_{camera}"])
def test_two_cameras_that_are_told_by_a_number_are_refused(tmp_path, fails, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    Path("two").mkdir()
    for camera in (0, 1):
        for k in range(5):
            Path(f"two/{name.format(camera=camera, k=k)}.png").write_bytes(encoded(touch_images(1)[0]))
    write_table("ee.csv", "", with_times(seven()))
    message = fails("convert", "two", "push.mcap", "--poses", "ee.csv", "--rate", 30, "--shape", "disc")
    assert "two cameras?" in message


def test_rows_of_two_bodies_are_asked_about(folder, fails):
    rows = [
        (time, body, float(x) + off, y, theta)
        for time, x, y, theta in with_times(true_pose(POSE_TIME))
        for body, off in (("digit", 0.0), ("box", 0.2))
    ]
    write_table("ee.csv", "time,body,x,y,theta", rows)
    assert "are these of two bodies?" in refused(fails, "--image-times", image_table(), "--poses", "ee.csv")


def test_folders_and_options_that_do_not_fit_are_named(folder, fails):
    write_table("ee.csv", "", with_times(seven()))
    write_table("short.csv", "time", [(START + 0.1,), (START + 0.2,)])
    write_table("others.csv", "time,file", [(START + 0.1, "other.png")])
    assert "2 times" in refused(fails, "--image-times", "short.csv", "--poses", "ee.csv")
    assert "other.png" in refused(fails, "--image-times", "others.csv", "--poses", "ee.csv")
    Path("empty").mkdir()
    assert "empty" in fails("convert", "empty", "push.mcap", "--poses", "ee.csv", "--shape", "disc")
    assert "--shape" in fails("convert", "img", "push.mcap", "--poses", "ee.csv", "--rate", 30)
    assert "--poses" in fails("convert", "img", "push.mcap", "--rate", 30, "--shape", "disc")


def test_a_folder_is_tracked_as_it_is_converted(folder, run_palpate, fails):
    write_table("ee.csv", "", with_times(seven()))
    words = ("--image-times", image_table(), "--poses", "ee.csv")
    wanted = convert(run_palpate, *words)
    start = ("--tactile", "none", "--first-pose", 0.1, 0, 0.3)
    code, _, err = run_palpate("track", "img", "--shape", "0.09x0.06", *words, *start)
    assert code == 0, err
    assert palpate.load_recording("runs/img/recording.mcap").time.tolist() == wanted.time.tolist()
    assert run_palpate("track", "img", "--shape", "0.09x0.06", *words, *start, "--resume")[0] == 0
    assert "--poses" in fails("track", "img", "--shape", "0.09x0.06", *start, "--out", "other")
    assert not Path("other").exists()


def test_info_says_how_to_convert_a_folder(folder, run_palpate):
    image_table()
    write_table("ee.csv", "", with_times(seven()))
    code, out, _ = run_palpate("info", "img")
    assert code == 0
    assert "palpate convert --images img --image-times t.csv --poses ee.csv --shape" in out


def test_a_folder_around_that_of_images_names_it(folder, fails):
    Path("data set").mkdir()
    Path("img").rename("data set/img")
    for words in (("info", "data set"), ("track", "data set", "--shape", "disc")):
        assert "images are in data set/img: palpate info 'data set/img' says how" in fails(*words)


def day(time, zone="Z", day=True):
    """A time [s] after START as ISO 8601 has it; zones are two hours ahead of UTC unless they are Z."""
    ahead = 0 if zone in ("Z", "") else 7200
    when = datetime.fromtimestamp(START + ahead, UTC) + timedelta(microseconds=round(time * 1e6))
    return when.strftime("%Y-%m-%dT%H:%M:%S.%f" if day else "%H:%M:%S.%f") + zone


def dated(form):
    """Write both tables with times in a form."""
    poses = [[form(time), *map(repr, row.tolist())] for time, row in zip(POSE_TIME, true_pose(POSE_TIME), strict=True)]
    write_table("ee.csv", "time,x,y,theta", poses)
    write_table("t.csv", "time,file", [(form(time), f"frame_{k}.png") for k, time in enumerate(IMAGE_TIME)])


TABLES_OF_THESE = ("--image-times", "t.csv", "--poses", "ee.csv")


@pytest.mark.parametrize("zone", ["Z", "+02:00", "+0200"])
def test_times_with_a_date(folder, run_palpate, zone):
    dated(lambda time: day(time, zone))
    same_push(convert(run_palpate, *TABLES_OF_THESE))
    image_table()  # in seconds
    same_push(convert(run_palpate, *TABLES_OF_THESE))


def test_times_without_a_zone_or_a_day(folder, run_palpate, fails, caplog):
    dated(lambda time: day(time, ""))
    same_push(convert(run_palpate, *TABLES_OF_THESE))
    assert "no zone and are taken to be in UTC" in caplog.text
    dated(lambda time: day(time, "", day=False))
    same_push(convert(run_palpate, *TABLES_OF_THESE), START % 86400)
    dated(lambda time: day(time, "Z" if time < 0.3 else ""))
    assert "one form for all" in fails("convert", "--images", "img", "--shape", "0.09x0.06", "o.mcap", *TABLES_OF_THESE)


def lines_of(name):
    first, *rest = Path(name).read_text().splitlines()
    return first, rest


SHUFFLED = np.random.default_rng(0).permutation


@pytest.mark.parametrize("name", ["ee.csv", "t.csv"])
@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda rows: rows[::-1], "not in the order of time"),
        (lambda rows: SHUFFLED(rows).tolist(), "not in the order of time"),
        (lambda rows: [row for row in rows for _ in range(2)], "are there twice"),
        (lambda rows: rows + rows, "are there twice"),
        (lambda rows: [*rows, "Total" + "," * rows[0].count(",")], "Total"),
        (lambda rows: [*rows, rows[-1].split(",")[0]], "is no row like those above it"),
    ],
)
def test_rows_that_people_and_programs_leave(folder, run_palpate, caplog, name, change, told):
    dated(lambda time: f"{START + time:.6f}")
    header, rows = lines_of(name)
    Path(name).write_text("\n".join([header, *change(rows)]) + "\n")
    recording = convert(run_palpate, *TABLES_OF_THESE)
    same_push(recording)
    assert told in caplog.text and told in " ".join(recording.warnings)


def test_rows_of_two_recorders_differ_in_their_time_of_recording(folder, run_palpate, caplog):
    rows = with_times(true_pose(POSE_TIME))
    twice = [(f"{k}.{recorder}", *row) for k, row in enumerate(rows) for recorder in (1, 2)]
    write_table("ee.csv", "log_time,stamp,x,y,theta", twice)
    same_push(convert(run_palpate, "--image-times", image_table(), "--poses", "ee.csv"))
    assert "80 of 160 rows are there twice" in caplog.text


def test_two_takes_in_a_table_are_not_sorted(folder, fails):
    dated(lambda time: f"{START + time:.6f}")
    header, rows = lines_of("ee.csv")
    other = [f"{START + time + 0.003:.6f},1,1,0" for time in POSE_TIME]
    Path("ee.csv").write_text("\n".join([header, *rows, *other]) + "\n")
    assert "two takes" in fails("convert", "--images", "img", "--shape", "0.09x0.06", "o.mcap", *TABLES_OF_THESE)


@pytest.mark.parametrize(
    "header",
    [
        "time in ms,x in mm,y in mm,yaw in deg",
        "time,x,y,yaw\n[ms],[mm],[mm],[deg]",
        "t_ms,x_millimeters,y_mm,yaw_degrees",
    ],
)
def test_units_that_are_written_in_words_or_in_a_row_of_their_own(folder, run_palpate, header):
    image_table("t.csv", "time_ms,file", 1e3)
    rows = with_times(true_pose(POSE_TIME) * [1e3, 1e3, np.degrees(1.0)], 1e3)
    exact = [(1e3 * (START + time), *row[1:]) for time, row in zip(POSE_TIME, rows, strict=True)]
    write_table("ee.csv", header, exact)
    same_push(convert(run_palpate, *TABLES_OF_THESE))
