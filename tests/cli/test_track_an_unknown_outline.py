"""`palpate track` of an object whose outline is unknown or a sketch, and `palpate outline`."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_samples import decoded_by_another, pose_message, pose_times, push_messages, write_bag
from recording_samples import BLIND, pushed
from view_samples import imaged_push, imaged_push_of_hand

import palpate
from palpate.files import write_json

pytestmark = pytest.mark.usefixtures("folder")

ORACLE = ("--tactile", "oracle")
SCORES = {"outline_rms_mm", "outline_all_rms_mm", "outline_in_95", "outline_touched_in_95"}


def in_world(lines: Any, pose: Any) -> Any:
    turn = np.array([[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]])
    return np.stack(lines) @ turn.T + pose[:2]


def run_data(folder: str = "runs/push") -> Any:
    return json.loads(Path(folder, "outline.json").read_text())


def test_a_recording_says_how_far_off_the_outline_is(json_of):
    found = json_of("track", "push.mcap", "--shape", "unknown:80mm-300mm", *ORACLE)
    learnt = run_data()
    points = np.array(learnt["points"])
    off = np.abs(pushed().shape.signed_distance(points))
    touched = np.array(learnt["touched"])
    assert found["outline_rms_mm"] == pytest.approx(1e3 * np.sqrt(np.mean(off[touched] ** 2)))
    assert found["outline_in_95"] == pytest.approx(np.mean(off <= 1.96 * np.array(learnt["deviation"])))
    assert found["outline_touched_share"] == pytest.approx(touched.mean()) and 0.0 < touched.mean() < 0.5
    assert found["scored_frames"] == 40 and found["statuses"].get("tracking", 0) == 0
    known = json_of("track", "push.mcap", *ORACLE, "--out", "known")
    assert not any(name.startswith("outline") for name in known) and not Path("known/outline.json").exists()


def test_python_and_command_agree(json_of):
    found = json_of("track", "push.mcap", "--shape", "unknown", *ORACLE)
    recording = palpate.load_recording("push.mcap")
    run = palpate.track(recording, palpate.TrackerSettings("oracle"), outline=palpate.Unknown())
    assert {name: run.summary[name] for name in SCORES} == {name: found[name] for name in SCORES}
    assert len(run.outlines) == len(recording)


def test_without_a_first_pose_the_frame_is_that_of_the_truth_at_the_first_contact(json_of):
    found = json_of("track", "push.mcap", "--shape", "unknown", "--first-pose-unknown", *ORACLE)
    first = int(np.argmax(pushed().contact))
    online = np.genfromtxt("runs/push/estimates.csv", delimiter=",", names=True, usecols=range(4))
    pose = np.column_stack((online["x"], online["y"], online["theta"]))
    assert np.allclose(pose[: first + 1], pushed().object_pose[first], atol=1e-9)
    assert found["outline_rms_mm"] is not None


def test_ground_truth_moves_the_band_with_the_outline():
    """Without a first pose a run puts the object frame where the truth has it: in the world nothing moves."""
    recording = palpate.load_recording("push.mcap")
    shape = palpate.Unknown((0.08, 0.3))
    settings = palpate.TrackerSettings("oracle", smoother="fixed-lag")
    run = palpate.track(recording, settings, np.zeros(3), first_pose_sigma=(1.0, 1.0, 2.0), outline=shape)
    tracker = palpate.Tracker(shape, recording.sensor, None, settings)
    last = [tracker.update(frame) for frame in recording][-1]
    assert last.outline is not None and not np.allclose(last.pose, run.online.pose[-1], atol=1e-3)
    moved = run.outlines[-1]
    inner, outer = moved.edges()
    assert np.allclose(
        in_world((moved.points, inner, outer), run.online.pose[-1]),
        in_world((last.outline.points, *last.outline.edges()), last.pose),
    )
    assert moved.signed_distance(inner).max() <= 1e-12 and moved.signed_distance(outer).min() >= -1e-12


def test_without_truth_nothing_is_scored(json_of):
    found = json_of("track", "blind.mcap", "--shape", "unknown")
    assert not SCORES & found.keys() and found["outline_sigma_mm"] > 1.0
    (warning,) = found["warnings"]
    assert "blind.mcap" in warning and "contact directions" in warning
    assert found["final_status"] == "uncertain" and "contact directions" in found["final_reason"]


def test_an_oracle_of_turns_tells_no_form_and_is_warned_of(json_of):
    found = json_of("track", "push.mcap", "--shape", "unknown", *ORACLE)
    (warning,) = found["warnings"]
    assert "push.mcap" in warning and "contact directions" in warning and "contact directions" in found["final_reason"]


def test_a_bag_has_no_true_outline(json_of):
    poses = [pose_message(stamp, np.array((0.4, 0.0, 0.0)), "/object") for stamp in pose_times()]
    both = sorted([*push_messages(), *poses], key=lambda message: message.log_time)
    bag = write_bag(Path("push"), "ros1", both)
    topics = ("--object-poses", "/object", "--sensor-poses", "/ee_pose", "--tactile", "none")
    found = json_of("track", bag, "--shape", "unknown", *topics)
    assert found["scored_frames"] and found["outline_touched_share"] >= 0.0 and not SCORES & found.keys()
    sketched = json_of("track", bag, "--shape", "rectangle", "--outline-sigma", "5mm", *topics, "--force")
    assert "outline_sigma_mm" in sketched and not SCORES & sketched.keys()


def test_a_learnt_outline_is_a_drawing_for_next_time(json_of, succeeds):
    succeeds("track", "push.mcap", "--shape", "unknown", *ORACLE)
    points = np.array(run_data()["points"])
    for name in ("part.json", "part.svg"):
        about = json_of("outline", "runs/push", "--out", name)
        shape = palpate.load_shape(name)
        moved = shape.centroid if name == "part.svg" else palpate.Polygon(points).centroid
        placed = points - palpate.Polygon(points).centroid + moved
        assert np.abs(shape.signed_distance(placed)).max() < 2e-4
        assert about["sigma_mm"] == pytest.approx(1e3 * np.sqrt(np.mean(np.square(run_data()["deviation"]))))
        again = json_of(
            "track", "push.mcap", "--shape", name, "--outline-sigma", "5mm", *ORACLE, "--out", f"again-{name}"
        )
        assert again["outline_all_rms_mm"] > 0.0


def test_an_outline_is_not_overwritten(run_palpate, succeeds):
    succeeds("track", "push.mcap", "--shape", "unknown", *ORACLE)
    succeeds("outline", "runs/push", "--out", "part.svg")
    before = Path("part.svg").read_bytes()
    code, _, err = run_palpate("outline", "runs/push", "--out", "part.svg")
    assert code == 2 and "part.svg" in err and Path("part.svg").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("track", "push.mcap", "--shape", "unknown:200mm-50mm"), "size"),
        (("track", "push.mcap", "--shape", "unknown:big"), "unknown:big"),
        (("track", "push.mcap", "--shape", "unknown", "--outline-sigma", "5mm"), "--outline-sigma"),
        (("track", "push.mcap", "--outline-sigma", "5mm"), "--outline-sigma"),
        (("track", "push.mcap", "--shape", "rectangle", "--outline-sigma", "90mm"), "--shape rectangle with --outline"),
        (("track", "push.mcap", "--shape", "l.csv", "--outline-sigma", "5mm"), "l.csv"),
        (("track", "push.mcap", "--shape", "l.csv"), "--outline-sigma"),
        (("track", "push.mcap", "--shape", "unknown", "--shape-unit", "mm"), "--shape-unit"),
        (
            ("track", "push.mcap", "--shape", "rectangle", "--outline-sigma", "5mm", "--first-pose-unknown"),
            "first pose",
        ),
        (("outline", "runs/none", "--out", "part.svg"), "runs/none"),
        (("outline", "runs/none", "--out", "part.png"), "runs/none"),
    ],
)
def test_what_cannot_be_is_one_sentence(run_palpate, words, named):
    Path("l.csv").write_text("x,y\n0.01,0\n0.11,0\n0.11,0.1\n0.1,0.1\n0.1,0.01\n0.01,0.01\n")
    code, out, err = run_palpate(*words)
    assert code == 2 and out == "" and named in err and len(err.splitlines()) == 1
    assert not Path("runs").exists() and not Path("part.svg").exists()


@pytest.mark.parametrize("outline", ["unknown", palpate.Rectangle(0.1, 0.1)])
def test_python_takes_no_other_outline_to_be_learnt(outline):
    with pytest.raises(palpate.SettingError, match=r"palpate\.Unknown"):
        palpate.track(pushed(), outline=outline)


def test_runs_are_kept_apart_by_their_outlines(json_of, run_palpate):
    options = ("track", "push.mcap", "blind.mcap", "--out", "many", "--resume", "--first-pose", "0", "0", "3")
    run_palpate(*options, "--shape", "unknown")
    assert json.loads(run_palpate(*options, "--shape", "unknown", "--json")[1])["kept"] == 2
    code, out, _ = run_palpate(*options, "--shape", "unknown:50mm-300mm", "--json")
    assert code == 3 and len(json.loads(out)["failed"]) == 2


def test_page_and_messages_show_the_outline_as_it_is_learnt(succeeds):
    palpate.write_recording(imaged_push(), "imaged.mcap")
    succeeds("track", "imaged.mcap", "--shape", "unknown", *ORACLE, "--html", "--mcap")
    data = json.loads(re.findall(r"const run = (.*);\n", Path("runs/imaged/page.html").read_text("utf-8"))[0])
    places = [place for place, *_ in data["learnt"]]
    assert places[0] == 0 and places[-1] == len(data["time"]) - 1 and data["showsTruth"]
    points = 1e3 * np.array(run_data("runs/imaged")["points"])
    assert np.allclose(data["learnt"][-1][1], points, atol=0.06)
    found = decoded_by_another(Path("runs/imaged/estimates.mcap"))
    _, last = found["/palpate/outline"][-1]
    x, y, theta = data["pose"][-1]
    turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    placed = 1e3 * np.array([(point.x, point.y) for point in last.polygon.points])
    assert np.allclose(placed, points @ turn.T + (x, y), atol=0.1)
    spread = [
        np.ptp([(point.x, point.y) for point in found[f"/palpate/outline{edge}"][-1][1].polygon.points], axis=0)
        for edge in ("_inner", "", "_outer")
    ]
    assert (np.diff(spread, axis=0) > 0.0).all()
    _, cloud = found["/palpate/outline_points"][-1]
    in_cloud = np.frombuffer(bytes(cloud.data), "<f4").reshape(cloud.width, 3)
    assert [(field.name, field.offset, field.datatype) for field in cloud.fields] == [
        ("x", 0, 7),
        ("y", 4, 7),
        ("z", 8, 7),
    ]
    in_polygons = [
        (point.x, point.y, point.z)
        for edge in ("", "_inner", "_outer")
        for point in found[f"/palpate/outline{edge}"][-1][1].polygon.points
    ]
    assert np.array_equal(in_cloud, np.array(in_polygons, np.float32))


def test_messages_show_no_outline_while_the_object_may_be_anywhere(succeeds):
    succeeds("track", "push.mcap", "--shape", "unknown", "--first-pose-unknown", *ORACLE, "--mcap")
    found = decoded_by_another(Path("runs/push/estimates.mcap"))
    first = int(np.argmax(pushed().contact))
    assert first > 0
    times = [time for time, _ in found["/palpate/object_pose"]]
    for name in ("outline", "outline_inner", "outline_outer", "outline_points"):
        assert [time for time, _ in found[f"/palpate/{name}"]] == times[first:]
    succeeds("track", "push.mcap", "--shape", "unknown", *ORACLE, "--mcap", "--out", "known-start")
    assert len(decoded_by_another(Path("known-start/estimates.mcap"))["/palpate/outline"]) == len(times)


def test_a_drawing_says_what_of_it_is_a_guess(run_palpate, succeeds):
    succeeds("track", "push.mcap", "--shape", "unknown", *ORACLE)
    code, out, _ = run_palpate("outline", "runs/push", "--out", "part.svg")
    assert code == 0 and "is a guess" in out and "next time: --shape part.svg" in out
    (widest,) = re.findall(r"widest_gap_share +(\S+)", out)
    assert f"{float(widest):.0%} of it" in out
    data = run_data()
    write_json(Path("runs/push/outline.json"), data | {"touched": [True] * len(data["touched"])})
    code, out, _ = run_palpate("outline", "runs/push", "--out", "touched.svg")
    assert code == 0 and "is a guess" not in out
    write_json(Path("runs/push/outline.json"), data | {"deviation": [0.2] * len(data["deviation"])})
    code, out, _ = run_palpate("outline", "runs/push", "--out", "vague.svg")
    assert code == 0 and "next time" not in out and "cannot be the sketch" in out


def test_a_live_session_keeps_that_the_outline_is_unknown(run_palpate, json_of):
    palpate.write_recording(replace(imaged_push(), **BLIND), "imaged.mcap")
    words = ("live", "--replay", "imaged.mcap", "--shape", "unknown", "--tactile", "none", "--record", "live.mcap")
    code, out, _ = run_palpate(*words, "--json")
    assert code == 0 and json.loads(out)["status"] == "uncertain"
    assert "/palpate/outline" in decoded_by_another(Path("live.mcap"))
    assert json_of("info", "live.mcap")["shape"] == "unknown"
    code, _, err = run_palpate("track", "live.mcap", "--first-pose", "0.3", "0.05", "0")
    assert code == 2 and "outline" in err
    code, _, _ = run_palpate("track", "live.mcap", "--shape", "unknown")
    assert code == 0
    kept = palpate.load_recording("live.mcap")
    palpate.write_recording(kept, "kept.mcap")
    assert not palpate.load_recording("kept.mcap").is_shape_known


def test_a_hand_learns_no_outline(fails):
    palpate.write_recording(imaged_push_of_hand(), "hand.mcap")
    assert "hand.mcap" in fails("track", "hand.mcap", "--shape", "unknown")


def test_a_folder_of_images_needs_no_outline(json_of):
    push = imaged_push()
    assert push.image is not None
    Path("images").mkdir()
    for number, image in enumerate(push.image):
        Path(f"images/{number:04}.png").write_bytes(image)
    rows = [
        ",".join(map(repr, (time, *pose)))
        for time, pose in zip(push.time.tolist(), push.sensor_pose.tolist(), strict=True)
    ]
    Path("poses.csv").write_text("\n".join(("time,x,y,theta", *rows)) + "\n")
    Path("small.toml").write_text('name = "small"\nradius = 0.01\nimage_height = 40\nimage_width = 30\n')
    options = ("--poses", "poses.csv", "--rate", "30", "--sensor", "small.toml", "--tactile", "none")
    found = json_of("track", "images", *options, "--shape", "unknown")
    assert found["frames"] == len(push) and not SCORES & found.keys() and found["outline_touched_share"] > 0.0
