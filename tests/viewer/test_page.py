"""The page of a run, which `palpate track --html` writes."""

import base64
import io
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from PIL import Image
from recording_samples import BLIND, pushed
from view_samples import FIRST, FRAMES, LAST, imaged_push

import palpate
from palpate.viewer.page import pictures


@pytest.fixture(scope="module")
def folder(tmp_path_factory, command) -> Path:
    folder = tmp_path_factory.mktemp("page")
    palpate.write_recording(imaged_push(), folder / "push<1>.mcap")
    assert command("track", folder / "push<1>.mcap", "--html", "--out", folder / "run") == 0
    return folder / "run"


@pytest.fixture
def written(folder) -> Path:
    return folder / "page.html"


def pictures_in(path: Path) -> list[Image.Image]:
    coded = re.findall(r'"data:image/webp;base64,(.*?)"', path.read_text(encoding="utf-8"))
    return [Image.open(io.BytesIO(base64.b64decode(each))) for each in coded]


def test_it_needs_nothing_else_and_has_a_picture_of_each_frame(written):
    text = written.read_text(encoding="utf-8")
    assert "src=" not in text and len(pictures_in(written)) == FRAMES
    assert "://" not in text  # addresses: "http" alone also occurs in pictures as base64 by chance


def test_object_and_touch_image_move_from_picture_to_picture():
    run = palpate.track(imaged_push())
    before, first, last = pictures(run, [2, FIRST + 1, LAST])
    blue, orange = (0, 114, 178), (222, 119, 51)  # of the estimate; of the sensor, over white

    def middle(picture, colour):
        columns = np.flatnonzero((np.abs(picture.astype(int) - colour).max(axis=-1) < 12)[:, : picture.shape[1] // 2])
        return np.median(columns % (picture.shape[1] // 2))

    for colour in (blue, orange):
        assert middle(first, colour) + 20 < middle(last, colour)
    right = slice(200, 400), slice(980, None)  # the touch image
    assert (before[right] != first[right]).any()


def opened(browser: Any, path: Any, width: int = 1280, mobile: bool = False) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": mobile}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get(path.as_uri())


def test_the_slider_shows_another_picture(written, browser):
    opened(browser, written)
    source = "return document.getElementById('picture').src"
    at_the_end = browser.execute_script(source)
    browser.execute_script(
        "const slider = document.getElementById('slider'); slider.value = 30;slider.dispatchEvent(new Event('input'))"
    )
    assert browser.execute_script(source) != at_the_end
    assert browser.execute_script("return document.images[0].naturalWidth") == 1150
    assert browser.get_log("browser") == []
    assert browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)") == []


def test_a_run_without_images_and_truth_on_a_phone(tmp_path, browser, command):
    palpate.write_recording(replace(pushed(10), **BLIND), tmp_path / "blind.mcap")
    words = ("track", tmp_path / "blind.mcap", "--html", "--first-pose", 0, 0, 3, "--out", tmp_path / "run")
    assert command(*words) == 0
    page = tmp_path / "run" / "page.html"
    opened(browser, page, width=390, mobile=True)
    assert browser.execute_script("return document.scrollingElement.scrollWidth - innerWidth") <= 0
    assert browser.get_log("browser") == []


def test_a_run_without_contact(tmp_path, command):
    push = pushed(10)
    assert push.contact is not None
    palpate.write_recording(replace(push, contact=~push.contact & False), tmp_path / "away.mcap")
    assert command("track", tmp_path / "away.mcap", "--html", "--out", tmp_path / "run") == 0
    assert len(pictures_in(tmp_path / "run" / "page.html")) == len(push)


def test_a_name_that_is_no_text_and_settings_of_the_user(tmp_path, command, monkeypatch, caplog):
    monkeypatch.setitem(matplotlib.rcParams, "text.usetex", True)
    monkeypatch.setitem(matplotlib.rcParams, "axes.titlesize", 40.0)
    push = tmp_path / os.fsdecode(b"r\xfcck.mcap")
    palpate.write_recording(replace(pushed(10), first_pose=(0.0, 0.0, 3.0)), tmp_path / "push.mcap")
    try:
        (tmp_path / "push.mcap").rename(push)
    except OSError:
        pytest.skip("this file system takes no such names")
    assert command("track", push, "--html", "--out", tmp_path / "run") == 0
    assert (tmp_path / "run" / "page.html").exists()
    assert caplog.text == "" and (tmp_path / "run" / "figure.png").exists()
    assert matplotlib.rcParams["text.usetex"] is True


def test_a_picture_that_fails_loses_nothing_else(tmp_path, command, monkeypatch, caplog):
    def fail(*_: Any, **__: Any) -> None:
        raise RuntimeError("no font")

    monkeypatch.setattr("palpate.pipeline.run_folder.run_figure", fail)
    monkeypatch.setattr("palpate.viewer.page.run_figure", fail)
    palpate.write_recording(replace(pushed(10), first_pose=(0.0, 0.0, 3.0)), tmp_path / "push.mcap")
    assert command("track", tmp_path / "push.mcap", "--html", "--out", tmp_path / "run") == 0
    left = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"estimates.csv", "summary.json"} <= left and not {"figure.png", "page.html"} & left
    for name in ("figure.png", "page.html"):
        assert f"{name} is left out: RuntimeError: no font" in caplog.text
