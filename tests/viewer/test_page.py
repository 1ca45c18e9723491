import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from page_samples import Page
from recording_samples import pushed
from view_samples import FIRST, FRAMES, LAST, tracked_push

from palpate.cli import main
from palpate.errors import FileError
from palpate.io.recording_mcap import write_recording
from palpate.pipeline.run_folder import FILES, PAGE
from palpate.pipeline.track import track
from palpate.viewer import page as page_module
from palpate.viewer.page import PageLimits, page_data, write_page


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Any:
    path = tmp_path_factory.mktemp("page") / "page.html"
    write_page(tracked_push(), "push <1>", path)
    return path


def data_of(path: Any) -> dict[str, Any]:
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', path.read_text(encoding="utf-8"))
    assert found
    return json.loads(found[1])


def test_the_page_needs_nothing_but_itself(written):
    text = written.read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>") and "<h1>push &lt;1&gt;</h1>" in text
    page = Page(text)
    assert page.all("link", "href") == ["data:,"] and page.all("script", "src") == []
    assert "://" not in text and "url(" not in text and "@import" not in text


def test_it_tells_errors_with_coverage_beside_them(written):
    words, summary = Page(written.read_text(encoding="utf-8")).words, tracked_push().summary
    assert f"At the end {summary['final_translation_error_mm']:.1f} mm" in words
    assert f"in contact {100 * summary['in_95_contact_share']:.0f} %" in words
    assert f"at rest {100 * summary['in_95_rest_share']:.0f} %" in words


def test_it_holds_what_the_run_says(written):
    data, run = data_of(written), tracked_push()
    assert run.truth is not None
    assert len(data["time"]) == len(data["estimate"]) == len(data["halfAxes"]) == FRAMES
    np.testing.assert_allclose(np.array(data["estimate"])[:, :2], 1e3 * run.online.pose[:, :2], atol=0.006)
    assert data["truth"][3] is None and data["translation"]["error"][3] is None
    np.testing.assert_allclose(data["truth"][5], run.truth[5] * (1e3, 1e3, 1), atol=0.006)
    assert list(data["others"]) == ["30"] and len(data["others"]["30"]) == 1
    assert data["status"] == list(run.online.status or ())
    touching = [frame for frame, point in enumerate(data["contact"]) if point[0] is not None]
    assert touching and touching[0] >= FIRST and touching[-1] <= LAST + 1
    assert len(data["pictures"]) == FRAMES and data["pictures"][0]["model"] is None
    assert data["pictures"][30]["model"].startswith("data:image/jpeg;base64,")


def test_long_runs_are_thinned(monkeypatch):
    monkeypatch.setattr(page_module, "LIMITS", PageLimits(frames=20, pictures=25))
    data = page_data(tracked_push())
    assert len(data["time"]) == 17 and data["time"][1] == 0.1
    assert list(data["others"]) == ["10"]  # frame 30
    assert len(data["pictures"]) == 25
    monkeypatch.setattr(page_module, "LIMITS", PageLimits(frames=20, pictures=25, picture_bytes=12_000))
    few = page_data(tracked_push())["pictures"]
    assert 0 < len(few) < 25 and sum(len(each["touch"]) for each in few) < 16_000


def test_a_page_is_replaced_only_if_asked_for(written):
    with pytest.raises(FileError, match="already exists"):
        write_page(tracked_push(), "push", written)


def test_track_leaves_a_page_in_the_folder_of_the_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_recording(pushed(), "push.mcap")
    assert main.main(["track", "push.mcap", "--html"]) == 0
    assert {path.name for path in (tmp_path / "runs" / "push").iterdir()} == {*FILES, PAGE}
    assert main.main(["track", "push.mcap", "--force"]) == 0  # a page is part of a run, which is replaced
    assert not (tmp_path / "runs" / "push" / PAGE).exists()


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
    status = tracked_push().online.status
    assert status is not None
    assert (shown(browser, "time"), shown(browser, "word")) == ("1.00 s", status[30])
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


def test_a_run_without_images_and_truth_on_a_phone(tmp_path, browser):
    run = track(replace(pushed(), object_pose=None), first_pose=(0.0, 0.0, 3.0))
    write_page(run, "blind", tmp_path / "page.html")
    opened(browser, tmp_path / "page.html", width=390, mobile=True)
    assert browser.execute_script("return document.images.length") == 0
    assert browser.execute_script("return document.scrollingElement.scrollWidth - innerWidth") <= 0
    assert "The truth is not known." in Page((tmp_path / "page.html").read_text(encoding="utf-8")).words
    move_slider(browser, 20)
    assert browser.get_log("browser") == []
