"""The page of a run, which `palpate track --html` writes."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from page_samples import Page
from recording_samples import pushed
from view_samples import FIRST, FRAMES, LAST, imaged_push

import palpate


@pytest.fixture(scope="module")
def folder(tmp_path_factory, command) -> Path:
    """The folder of a run with a page."""
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


def test_the_page_needs_no_other_file(written):
    text = written.read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>") and "<h1>push&lt;1&gt;.mcap</h1>" in text
    page = Page(text)
    assert page.all("link", "href") == ["data:,"] and page.all("script", "src") == []
    assert "://" not in text and "url(" not in text and "@import" not in text


def test_it_shows_errors_with_coverage_beside_them(folder, written):
    words, summary = Page(written.read_text(encoding="utf-8")).words, json.loads((folder / "summary.json").read_text())
    assert f"At the end {summary['final_translation_error_mm']:.1f} mm" in words
    assert f"in contact {100 * summary['in_95_contact_share']:.0f} %" in words
    assert f"at rest {100 * summary['in_95_rest_share']:.0f} %" in words


def test_it_holds_the_run(written):
    data, run = data_of(written), palpate.track(imaged_push())
    assert run.truth is not None
    assert len(data["time"]) == len(data["estimate"]) == len(data["halfAxes"]) == FRAMES
    np.testing.assert_allclose(np.array(data["estimate"])[:, :2], 1e3 * run.online.pose[:, :2], atol=0.006)
    assert data["truth"][3] is None and data["translation"]["error"][3] is None
    np.testing.assert_allclose(data["truth"][5], run.truth[5] * (1e3, 1e3, 1), atol=0.006)
    assert data["status"] == list(run.online.status or ())
    touching = [frame for frame, point in enumerate(data["contact"]) if point[0] is not None]
    assert touching and touching[0] >= FIRST and touching[-1] <= LAST + 1
    assert len(data["pictures"]) == FRAMES and data["pictures"][0]["model"] is None
    assert data["pictures"][30]["model"].startswith("data:image/jpeg;base64,")


def test_long_runs_are_thinned(folder, tmp_path, command, monkeypatch):
    for most, pictures in ((1e6, 25), (12_000, None)):
        limits = SimpleNamespace(frames=20, pictures=25, picture_bytes=most, picture_width=160)
        monkeypatch.setattr("palpate.viewer.page.LIMITS", limits)
        out = tmp_path / str(pictures)
        assert command("track", folder.parent / "push<1>.mcap", "--html", "--out", out) == 0
        data = data_of(out / "page.html")
        assert len(data["time"]) == 17 and data["time"][1] == 0.1
        assert len(data["pictures"]) == pictures or 0 < len(data["pictures"]) < 25
        assert sum(len(each["touch"]) for each in data["pictures"]) < 4 * most / 3


def opened(browser: Any, path: Any, width: int = 1280, mobile: bool = False) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": mobile}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get(path.as_uri())


def drawn(browser: Any) -> list[str]:
    """What each canvas shows."""
    return browser.execute_script("return [...document.querySelectorAll('canvas')].map(c => c.toDataURL())")


def shown(browser: Any, name: str) -> str:
    return browser.execute_script(f"return document.getElementById('{name}').textContent")


def move_slider(browser: Any, frame: int) -> None:
    browser.execute_script(
        "const slider = document.getElementById('slider'); slider.value = arguments[0];"
        "slider.dispatchEvent(new Event('input'))",
        frame,
    )


def test_the_slider_moves_everything(written, browser):
    opened(browser, written)
    at_the_end = drawn(browser)
    assert shown(browser, "time") == "1.63 s"
    move_slider(browser, 30)
    assert (shown(browser, "time"), shown(browser, "word")) == ("1.00 s", data_of(written)["status"][30])
    assert all(now != before for now, before in zip(drawn(browser), at_the_end, strict=True))
    touch, model = browser.execute_script("return [...document.images].map(i => i.src)")
    picture = data_of(written)["pictures"][30]
    assert (touch, model) == (picture["touch"], picture["model"])
    assert browser.get_log("browser") == []
    assert browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)") == []


def test_it_plays_to_the_end_and_pauses(written, browser):
    opened(browser, written)
    play = "document.getElementById('play').click()"
    word = "document.getElementById('play').textContent"
    words = browser.execute_async_script(
        f"const done = arguments[0]; {play}; const playing = {word};"
        f"setTimeout(() => {{ {play}; done([playing, {word}]); }}, 100)"
    )
    assert words == ["Pause", "Play"] and float(shown(browser, "time").split()[0]) < 1.6  # not the end any more
    move_slider(browser, FRAMES - 5)
    browser.set_script_timeout(10)
    browser.execute_async_script(
        f"const done = arguments[0]; {play}; const look = () => "
        "document.getElementById('play').textContent === 'Play' ? done() : setTimeout(look, 20); look()"
    )
    assert shown(browser, "time") == "1.63 s"
    browser.execute_script(
        "const plot = document.getElementById('rotation');"
        "plot.dispatchEvent(new MouseEvent('click', {clientX: plot.getBoundingClientRect().left + 45}))"
    )
    assert shown(browser, "time") == "0.00 s"
    assert browser.get_log("browser") == []


def test_a_run_without_images_and_truth_on_a_phone(tmp_path, browser, command):
    palpate.write_recording(replace(pushed(), object_pose=None), tmp_path / "blind.mcap")
    words = ("track", tmp_path / "blind.mcap", "--html", "--first-pose", 0, 0, 3, "--out", tmp_path / "run")
    assert command(*words) == 0
    page = tmp_path / "run" / "page.html"
    opened(browser, page, width=390, mobile=True)
    assert browser.execute_script("return document.images.length") == 0
    assert browser.execute_script("return document.scrollingElement.scrollWidth - innerWidth") <= 0
    assert "The truth is not known." in Page(page.read_text(encoding="utf-8")).words
    move_slider(browser, 20)
    assert browser.get_log("browser") == []
