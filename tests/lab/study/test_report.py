"""The report page of a study, made by the command and opened in a browser."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from page_samples import Page
from recording_samples import pushed

import palpate


@pytest.fixture
def report(tmp_path, run_palpate) -> Path:
    """Evaluate three recordings, one of them without ground truth and one damaged."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    for name, frames in (("disc-1.mcap", 40), ("disc-2.mcap", 60), ("edges-1.mcap", 50)):
        palpate.write_recording(replace(pushed(frames), source=f"a test, <seed {frames}>"), folder / name)
    palpate.write_recording(replace(pushed(20), object_pose=None), folder / "blind-1.mcap")
    (folder / "bad.mcap").write_text("<bad>")
    words = ("evaluate", folder, "--tactile", "none", "oracle")
    assert run_palpate(*words, "--out", tmp_path / "new")[0] == 3
    return tmp_path / "new"


def test_the_page_holds_tables_and_figures(report):
    page = Page((report / "report.html").read_text(encoding="utf-8"))
    results: Any = json.loads((report / "results.json").read_text(encoding="utf-8"))
    assert page.open == []
    # It needs nothing but itself.
    assert all(source.startswith("data:image/png;base64,") for source in page.all("img", "src"))
    assert not [tag for tag, _ in page.tags if tag in ("script", "iframe", "object")]
    figures = {"over-time", "final-errors"}
    assert set(page.all("figure", "id")) == figures == {path.stem for path in (report / "figures").iterdir()}
    # The table is that of results.json, in words.
    row = results["table"]["disc"]["oracle"]
    mm, deg = row["final_mm"], row["final_deg"]
    words = page.words
    assert f"{mm['median']:.1f} mm, {deg['median']:.1f}° ({mm['worst']:.0f}, {deg['worst']:.0f})" in words
    assert "a test, <seed 40>" in words and "bad.mcap" in words and "noise.sensor_pose.deviation" in words
    assert results["command"] in words and "has no ground truth" in words


def test_groups_are_folders_or_names_without_their_number(tmp_path, run_palpate):
    """And no cell of the table begins a formula."""
    groups = {
        "rectangle-edges-1100000.mcap": "rectangle-edges",
        "disc_12.mcap": "disc",
        "0007.mcap": "0007",
        "real/cmu/log-1.mcap": "real/cmu",
        "=a+1.mcap": "=a",
    }
    for name in groups:
        (tmp_path / "all" / name).parent.mkdir(parents=True, exist_ok=True)
        palpate.write_recording(pushed(20), tmp_path / "all" / name)
    assert run_palpate("evaluate", tmp_path / "all", "--tactile", "none", "--out", tmp_path / "out")[0] == 0
    table = (tmp_path / "out/sequences.csv").read_text()
    assert {
        row["recording"].strip("'"): row["group"].strip("'") for row in csv.DictReader(table.splitlines())
    } == groups
    assert "'=a+1.mcap,'=a," in table and not [line for line in table.splitlines() if line.startswith("=")]


def test_the_page_in_a_browser(report, browser):
    for width, height, mobile in ((1280, 800, False), (390, 844, True)):
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        browser.get((report / "report.html").as_uri())
        assert browser.get_log("browser") == []
        assert browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)") == []
        assert all(browser.execute_script("return [...document.images].map(i => i.naturalWidth > 200)"))
        assert browser.execute_script("return document.scrollingElement.scrollWidth - innerWidth") <= 0
