"""The page of a run, which `palpate track --html` writes."""

import base64
import io
import json
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
from view_samples import FRAMES, LAST, imaged_push

import palpate


@pytest.fixture(scope="module")
def folder(tmp_path_factory, command) -> Path:
    folder = tmp_path_factory.mktemp("page")
    palpate.write_recording(imaged_push(), folder / "push<1>.mcap")
    assert command("track", folder / "push<1>.mcap", "--html", "--out", folder / "run") == 0
    return folder / "run"


@pytest.fixture
def written(folder) -> Path:
    return folder / "page.html"


def data_in(path: Path) -> Any:
    return json.loads(re.findall(r"const run = (.*);\n", path.read_text(encoding="utf-8"))[0])


def test_it_needs_nothing_else_and_has_a_pose_and_an_image_of_each_frame(written):
    text = written.read_text(encoding="utf-8")
    data = data_in(written)
    run = palpate.track(imaged_push())
    assert not re.search(r"<\w+[^>]* src=", text) and "://" not in text
    assert np.array(data["pose"]) == pytest.approx(run.online.pose * (1e3, 1e3, 1.0), abs=1e-3)
    assert data["status"] == list(run.online.status) and len(data["touch"]) == FRAMES
    assert [index for index, pose in enumerate(data["truth"]) if pose is None] == [3, 4]
    before, after = (
        Image.open(io.BytesIO(base64.b64decode(data["touch"][frame][1].partition(",")[2]))) for frame in (0, LAST)
    )
    assert np.mean(np.array(after)) > np.mean(np.array(before)) + 5.0


def opened(browser: Any, path: Any, width: int = 1280, mobile: bool = False) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": mobile}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get(path.as_uri())


SHOWN = "return [Number(document.getElementById('slider').value), document.getElementById('time').textContent]"
DRAWN = "return [...document.querySelectorAll('canvas')].map(canvas => canvas.toDataURL())"


def test_the_slider_shows_another_moment(written, browser):
    opened(browser, written)
    at_the_end = browser.execute_script(DRAWN)
    assert browser.execute_script(SHOWN) == [FRAMES - 1, "1.63 s"]
    browser.execute_script(
        "const slider = document.getElementById('slider'); slider.value = 30;slider.dispatchEvent(new Event('input'))"
    )
    assert browser.execute_script(SHOWN) == [30, "1.00 s"]
    assert all(new != old for new, old in zip(browser.execute_script(DRAWN), at_the_end, strict=True))
    assert browser.execute_script("return document.images[0].naturalWidth") == 920
    assert browser.get_log("browser") == []
    assert browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)") == []


def test_it_plays_by_button_and_by_keys(written, browser):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.wait import WebDriverWait

    opened(browser, written)
    body = browser.find_element(By.TAG_NAME, "body")
    play = browser.find_element(By.ID, "play")
    body.send_keys(Keys.HOME)
    body.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, Keys.ARROW_LEFT)
    assert browser.execute_script(SHOWN)[0] == 1
    body.send_keys(" ")
    assert play.text == "Pause"
    WebDriverWait(browser, 20).until(lambda _: browser.execute_script(SHOWN)[0] > 5)
    body.send_keys(" ")
    shown = browser.execute_script(SHOWN)[0]
    assert play.text == "Play" and browser.execute_script(SHOWN)[0] == shown
    body.send_keys(Keys.END)
    play.click()  # from the start
    WebDriverWait(browser, 20).until(lambda _: play.text == "Play" and browser.execute_script(SHOWN)[0] == FRAMES - 1)
    assert browser.get_log("browser") == []


def test_a_run_without_images_and_truth_on_a_phone(tmp_path, browser, command):
    palpate.write_recording(replace(pushed(10), **BLIND), tmp_path / "blind.mcap")
    words = ("track", tmp_path / "blind.mcap", "--html", "--first-pose", 0, 0, 3, "--out", tmp_path / "run")
    assert command(*words) == 0
    page = tmp_path / "run" / "page.html"
    opened(browser, page, width=390, mobile=True)
    assert browser.execute_script("return document.scrollingElement.scrollWidth - innerWidth") <= 0
    assert browser.execute_script("return document.getElementById('touch').offsetHeight") == 0
    assert browser.get_log("browser") == []


BLUE_IN_CANVAS = """
const canvas = document.querySelector('canvas');
const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
let count = 0;
for (let at = 0; at < data.length; at += 4) { count += data[at] < 20 && data[at + 2] > 150 && data[at + 3] > 250; }
return count;
"""


def test_an_object_that_nobody_drew_appears_at_its_first_contact_and_touched_parts_are_thick(
    tmp_path, browser, command
):
    palpate.write_recording(pushed(), tmp_path / "push.mcap")
    words = ("track", tmp_path / "push.mcap", "--html", "--shape", "unknown:80mm-300mm", "--first-pose-unknown")
    assert command(*words, "--tactile", "oracle", "--out", tmp_path / "run") == 0
    page = tmp_path / "run" / "page.html"
    opened(browser, page)
    seen = []
    for frame in (4, 5, 39):
        browser.execute_script(f"go({frame})")
        seen.append(browser.execute_script(BLUE_IN_CANVAS))
    browser.execute_script("run.learnt.forEach((learnt) => { learnt[4] = []; }); go(39)")
    without_touched = browser.execute_script(BLUE_IN_CANVAS)
    assert seen[0] == 0 < seen[1] and without_touched < seen[2]


def test_a_run_without_contact(tmp_path, command):
    push = pushed(10)
    assert push.contact is not None
    palpate.write_recording(replace(push, contact=~push.contact & False), tmp_path / "away.mcap")
    assert command("track", tmp_path / "away.mcap", "--html", "--out", tmp_path / "run") == 0
    assert len(data_in(tmp_path / "run" / "page.html")["pose"]) == len(push)


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
    monkeypatch.setattr("palpate.viewer.page.draw_from_above", fail)
    palpate.write_recording(replace(pushed(10), first_pose=(0.0, 0.0, 3.0)), tmp_path / "push.mcap")
    assert command("track", tmp_path / "push.mcap", "--html", "--out", tmp_path / "run") == 0
    left = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"estimates.csv", "summary.json"} <= left and not {"figure.png", "page.html"} & left
    for name in ("figure.png", "page.html"):
        assert f"{name} is left out: RuntimeError: no font" in caplog.text
