"""The page of a run, which `palpate track --html` writes."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from page_samples import Page
from recording_samples import pushed
from view_samples import FIRST, FRAMES, LAST, imaged_push

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


def data_of(path: Path) -> dict[str, Any]:
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', path.read_text(encoding="utf-8"))
    assert found
    return json.loads(found[1])


def test_it_shows_errors_with_coverage_beside_them(folder, written):
    page, summary = Page(written.read_text(encoding="utf-8")), json.loads((folder / "summary.json").read_text())
    assert "push<1>.mcap" in page.words and page.all("script", "src") == []
    assert f"At the end {summary['final_translation_error_mm']:.1f} mm" in page.words
    assert f"{100 * summary['in_95_share']:.0f} % of true poses lie in the 95 % region" in page.words


def test_it_holds_the_run(written):
    data, run = data_of(written), palpate.track(imaged_push())
    assert run.online.covariance is not None
    assert len(data["time"]) == len(data["estimate"]) == len(data["halfAxes"]) == FRAMES
    units = (1e3, 1e3, np.degrees(1.0))
    np.testing.assert_allclose(data["estimate"], run.online.pose * units, atol=1e-3)
    np.testing.assert_allclose(data["truth"][5], run.truth[5] * units, atol=1e-3)
    assert data["truth"][3] is None
    axes = np.reshape(data["halfAxes"][30], (2, 2)).T  # columns, which are orthogonal
    np.testing.assert_allclose(axes @ axes.T, 5.991 * 1e6 * run.online.covariance[30, :2, :2], rtol=0.01, atol=1e-3)
    assert data["status"] == list(run.online.status or ())
    touching = np.flatnonzero(data["contact"])
    assert touching[0] >= FIRST and touching[-1] <= LAST + 1
    assert len(data["touch"]) == FRAMES and data["touch"][30].startswith("data:image/jpeg;base64,")


def opened(browser: Any, path: Any, width: int = 1280, mobile: bool = False) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": mobile}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get(path.as_uri())


def shown(browser: Any, name: str) -> str:
    return browser.execute_script(f"return document.getElementById('{name}').textContent")


def move_slider(browser: Any, frame: int) -> None:
    browser.execute_script(
        "const slider = document.getElementById('slider'); slider.value = arguments[0];"
        "slider.dispatchEvent(new Event('input'))",
        frame,
    )


def middle(browser: Any, selector: str) -> Any:
    return np.array(
        browser.execute_script(
            f"const box = document.querySelector('{selector}').getBoundingClientRect();"
            "return [box.x + box.width / 2, box.y + box.height / 2]"
        )
    )


def test_the_slider_moves_everything(written, browser):
    opened(browser, written)
    assert shown(browser, "time") == "1.63 s"
    names = ("#truth", "#estimate", "#sensor", "#cursor")
    at_the_end = [middle(browser, name) for name in names]
    move_slider(browser, 30)
    data = data_of(written)
    assert (shown(browser, "time"), shown(browser, "status")) == ("1.00 s", data["status"][30])
    moves = [end - middle(browser, name) for name, end in zip(names, at_the_end, strict=True)]
    # On the same scale, so the sensor's path says how far the object has to move.
    scale = moves[2][0] / (data["sensor"][-1][0] - data["sensor"][30][0])
    for move, name in zip(moves[:2], ("truth", "estimate"), strict=True):
        assert move[0] == pytest.approx(scale * (data[name][-1][0] - data[name][30][0]), abs=0.5) and abs(move[1]) < 2.0
    assert moves[3][0] > 100.0
    assert browser.execute_script("return [...document.images].map(i => i.src)") == [data["touch"][30]]
    assert browser.get_log("browser") == []
    assert browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)") == []


def test_object_and_sensor_lie_over_the_axes(written, browser):
    """The overlay has the scale and origin of the drawing below: the sensor's last place ends its path."""
    opened(browser, written)
    move_slider(browser, LAST)
    estimate, sensor = data_of(written)["estimate"][LAST], data_of(written)["sensor"][LAST]
    gap = middle(browser, "#estimate > use") - middle(browser, "#sensor")
    scale = gap[0] / (estimate[0] - sensor[0] + 5.0)  # the pad reaches 10 mm back from its apex
    ticks = browser.execute_script(
        "return [...document.querySelectorAll('.layers:first-child #matplotlib\\\\.axis_1 text')]"
        ".map(t => [Number(t.textContent.replace('−', '-')), t.getBoundingClientRect().x + "
        "t.getBoundingClientRect().width / 2]).filter(([value]) => !isNaN(value))"
    )
    (low, left), (high, right) = ticks[0], ticks[-1]
    assert scale == pytest.approx((right - left) / (high - low), rel=0.05)
    expected = left + (estimate[0] - low) * (right - left) / (high - low)
    assert middle(browser, "#estimate > use")[0] == pytest.approx(expected, abs=2.0)


def test_a_run_without_images_and_truth_on_a_phone(tmp_path, browser, command):
    palpate.write_recording(replace(pushed(), object_pose=None), tmp_path / "blind.mcap")
    words = ("track", tmp_path / "blind.mcap", "--html", "--first-pose", 0, 0, 3, "--out", tmp_path / "run")
    assert command(*words) == 0
    page = tmp_path / "run" / "page.html"
    opened(browser, page, width=390, mobile=True)
    assert browser.execute_script("return document.images[0].style.visibility") == "hidden"
    assert browser.execute_script("return document.scrollingElement.scrollWidth - innerWidth") <= 0
    assert "The truth is not known." in Page(page.read_text(encoding="utf-8")).words
    move_slider(browser, 20)
    assert browser.get_log("browser") == []


def test_a_run_without_contact(tmp_path, command):
    push = pushed()
    assert push.contact is not None
    palpate.write_recording(replace(push, contact=~push.contact & False), tmp_path / "away.mcap")
    assert command("track", tmp_path / "away.mcap", "--html", "--out", tmp_path / "run") == 0
    words = Page((tmp_path / "run" / "page.html").read_text(encoding="utf-8")).words
    assert "° off." in words and "95 % region" not in words


def test_a_name_that_is_no_text_and_settings_of_the_user(tmp_path, command, monkeypatch, caplog):
    monkeypatch.setitem(matplotlib.rcParams, "text.usetex", True)
    monkeypatch.setitem(matplotlib.rcParams, "axes.titlesize", 40.0)
    push = tmp_path / os.fsdecode(b"r\xfcck.mcap")
    palpate.write_recording(replace(pushed(), first_pose=(0.0, 0.0, 3.0)), tmp_path / "push.mcap")
    try:
        (tmp_path / "push.mcap").rename(push)
    except OSError:
        pytest.skip("this file system takes no such names")
    assert command("track", push, "--html", "--out", tmp_path / "run") == 0
    assert r"<h1>r\udcfcck.mcap</h1>" in (tmp_path / "run" / "page.html").read_text(encoding="utf-8")
    assert caplog.text == "" and (tmp_path / "run" / "figure.png").exists()
    assert matplotlib.rcParams["text.usetex"] is True


def test_a_picture_that_fails_loses_nothing_else(tmp_path, command, monkeypatch, caplog):
    def fail(*_: Any) -> None:
        raise RuntimeError("no font")

    monkeypatch.setattr("palpate.pipeline.run_folder.run_figure", fail)
    monkeypatch.setattr("palpate.viewer.page.draw_path", fail)
    palpate.write_recording(replace(pushed(), first_pose=(0.0, 0.0, 3.0)), tmp_path / "push.mcap")
    assert command("track", tmp_path / "push.mcap", "--html", "--out", tmp_path / "run") == 0
    left = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"estimates.csv", "summary.json"} <= left and not {"figure.png", "page.html"} & left
    for name in ("figure.png", "page.html"):
        assert f"{name} is left out: RuntimeError: no font" in caplog.text
