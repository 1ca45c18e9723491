"""MIT pushes, from files made by hand."""

import gzip
import json

import numpy as np
import planar as se2
import pytest
from recording_samples import load, runs

from palpate import FileError, Rectangle
from palpate import io as formats


def mit(seconds=2.0, **changes):
    """Data of a push along +y at 50 mm/s: the square goes ahead of the tip and is measured every 4 ms."""
    time = 1.0 + np.arange(int(seconds * 1000)) * 1e-3
    y = (time - 1.0) * 0.05
    fresh = np.arange(len(time)) // 4 * 4
    wobble = 1e-6 * np.sin(np.arange(len(time)))
    slider = np.array([0.3 + wobble[fresh], y[fresh] + 0.045 + 0.00475, 0.1 * wobble[fresh]])
    pusher = np.array([np.full(len(time), 0.3), y])
    fields = {"timeJSON": time, "q_sliderJSON": slider, "q_pusher_sensedJSON": pusher}
    for key, change in changes.items():
        change(fields[f"{key}JSON"])
    return {key: value.tolist() for key, value in sorted(fields.items())}


def save_mit(path, data):
    text = json.dumps(data)
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(text.encode()))
    else:
        path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["run.json", "run.json.gz"])
def test_mit_is_read(tmp_path, name):
    path = save_mit(tmp_path / name, mit())
    assert formats.detect_format(path) == "mit-push"
    found = load(path)
    assert found.shape == Rectangle(0.09, 0.09)
    assert len(found) == 60  # 0 to 59/30 = 1.967 s; the last sample is at 1.999 s
    np.testing.assert_allclose(found.time, np.arange(60) / 30, atol=0.5e-3 + 1e-9)
    # The tip moves along +y: the apex is a radius further on, the centre of curvature the measured one.
    np.testing.assert_allclose(found.sensor_pose[:, 2], np.pi / 2)
    centers = se2.transform(found.sensor_pose[:, None], found.sensor.centers)[:, 0]
    np.testing.assert_allclose(centers[:, 0], 0.3, atol=1e-12)
    np.testing.assert_allclose(centers[:, 1], found.time * 0.05, atol=1e-12)
    assert found.contact is not None and found.contact.all()
    assert found.object_pose is not None and not np.isnan(found.object_pose).any()


def test_mit_drop_outs_have_no_truth(tmp_path):
    def drop(slider):
        slider[:, 1000:1100] = slider[:, 1000:1001]

    found = load(save_mit(tmp_path / "a.json", mit(q_slider=drop)))
    lost = np.isnan(found.object_pose[:, 0])
    # 1.000 s is measured, 1.001 to 1.099 s are not: of the frames at n/30 s, 31 and 32 (33 is at 1.100 s).
    assert np.flatnonzero(lost).tolist() == [31, 32]
    assert found.contact.all()


def test_mit_at_rest_nothing_drops_out(tmp_path):
    def rest(values):
        values[:, 1500:] = values[:, 1500:1501]

    found = load(save_mit(tmp_path / "a.json", mit(q_pusher_sensed=rest, q_slider=rest)))
    assert not np.isnan(found.object_pose).any()


def test_mit_late_truth_and_lost_contact(tmp_path):
    def late(slider):
        slider[1, 500:700] -= 0.005  # the tip seems to be 5 mm inside
        slider[1, 1500:1700] += 0.004  # a knock forwards: 4 mm between tip and square

    found = load(save_mit(tmp_path / "a.json", mit(q_slider=late)))
    # 0.5 to 0.699 s are frames 15 to 20; 1.5 to 1.699 s frames 45 to 50.
    assert runs(np.isnan(found.object_pose[:, 0])) == [[15, 21]]
    assert runs(~found.contact) == [[45, 51]]


def test_mit_clock_that_repeats_and_steps_back(tmp_path):
    def stutter(time):
        time[100:110] = time[100]
        time[500] = time[480]

    found = load(save_mit(tmp_path / "a.json", mit(time=stutter)))
    assert (np.diff(found.time) > 0.02).all()


def test_mit_tip_that_stands_still_points_along_x(tmp_path):
    def still(pusher):
        pusher[1] *= 0.05

    found = load(save_mit(tmp_path / "a.json", mit(q_pusher_sensed=still)))
    assert (found.sensor_pose[:, 2] == 0).all()


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda d: d.pop("q_sliderJSON"), "lacks q_sliderJSON"),
        (lambda d: d["q_sliderJSON"].pop(), r"q_sliderJSON: found shape \(2, 2000\), expected \(3, 2000\)"),
        (lambda d: d["q_sliderJSON"][0].pop(), "q_sliderJSON: rows have different lengths"),
        (lambda d: d["timeJSON"].__setitem__(3, float("nan")), "timeJSON: frame 3 is nan"),
        (lambda d: d["timeJSON"].__setitem__(3, "x"), "timeJSON: found text, expected numbers"),
        (lambda d: d["q_pusher_sensedJSON"][0].__setitem__(7, float("inf")), "q_pusher_sensedJSON: frame 7 is"),
        (lambda d: d.update(timeJSON=[], q_sliderJSON=[[]] * 3, q_pusher_sensedJSON=[[]] * 2), "no times"),
    ],
)
def test_mit_bad_content(tmp_path, edit, message):
    data = mit()
    edit(data)
    path = save_mit(tmp_path / "a.json", data)
    with pytest.raises(FileError, match=message) as caught:
        load(path)
    assert str(path) in str(caught.value)
