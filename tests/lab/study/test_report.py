import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from page_samples import Page
from study_samples import drawn_results, drawn_trials

from palpate.errors import FileError
from palpate.lab.study import report as report_module
from palpate.lab.study.comparison import compare
from palpate.lab.study.figures import study_sheets
from palpate.lab.study.report import write_report
from palpate.lab.study.reported import read_reported
from palpate.lab.study.results import write_results
from palpate.lab.study.trial import Method, Trial

METHODS = [Method("none", "fixed-lag"), Method("learnt", "fixed-lag"), Method("learnt", "isam2")]
GROUPS = ["disc", "rectangle-near-corners", "mit"]


def study(count: int = 4) -> tuple[list[Trial], dict[str, Any]]:
    """Return a study compared with one in which all errors were a millimetre larger."""
    trials = drawn_trials(GROUPS, METHODS, count, seconds=6.0)
    results = drawn_results(trials)
    before = {
        (trial.recording, trial.method): {
            "final_mm": trial.summary["final_translation_error_mm"] + 1.0,
            "final_deg": trial.summary["final_rotation_error_deg"],
            "rmse_mm": trial.summary["translation_rmse_mm"],
            "rmse_deg": trial.summary["rotation_rmse_deg"],
        }
        for trial in trials
    }
    return trials, {**results, "against": compare(Path("old"), before, trials)}


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    trials, results = study()
    write_report(folder, results, trials)
    return folder


@pytest.fixture
def words_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no figures, which takes seconds, where the page's words are looked at."""
    monkeypatch.setattr(report_module, "study_sheets", lambda *_: [])


@pytest.fixture(scope="module")
def page(report: Path) -> Page:
    text = (report / "report.html").read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>")
    page = Page(text)
    assert page.open == []
    return page


def test_page_needs_nothing_but_itself(page):
    sources = page.all("img", "src")
    assert sources and all(source.startswith("data:image/png;base64,") for source in sources)
    assert all(
        target.startswith("#") or target == "data:," for target in page.all("a", "href") + page.all("link", "href")
    )
    assert not [tag for tag, _ in page.tags if tag in ("script", "iframe", "object")]
    assert "url(" not in page.words and "@import" not in page.words


def test_contents_lead_somewhere(page):
    names = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(set(names)) == len(names)
    assert {target[1:] for target in page.all("a", "href")} <= set(names)


def test_figures_are_on_the_page_and_in_files(report, page):
    trials, results = study()
    sheets = study_sheets(trials, results)
    assert sorted(path.name for path in (report / "figures").iterdir()) == sorted(
        f"{sheet.name}.png" for sheet in sheets
    )
    assert page.all("figure", "id") == [sheet.name for sheet in sheets]
    assert page.all("img", "alt") == [tile.alt for sheet in sheets for tile in sheet.tiles]
    assert {"slid", "against-rotation"} < set(page.all("figure", "id"))


def test_headline_has_median_and_worst_of_each_group(page):
    trials, results = study()
    mit = [trial.summary for trial in trials if (trial.group, trial.method) == ("mit", METHODS[1])]
    mm, deg = (sorted(each[f"final_{name}"] for each in mit) for name in ("translation_error_mm", "rotation_error_deg"))
    # Of four the median is the mean of the middle ones.
    median = f"{(mm[1] + mm[2]) / 2:.1f} mm, {(deg[1] + deg[2]) / 2:.1f}°"
    words = page.words
    assert f"{median} ({mm[3]:.0f}, {deg[3]:.0f})" in words
    inside = results["table"]["all groups"]["none"]["inside_95"]
    assert f"{100 * inside:.0f} % {results['table']['all groups']['none']['lost']}" in words
    assert "12 recordings, 3 ways to track, 36 runs in 90.0 minutes with 2 workers on 2 cores." in words
    assert "all groups 12 sequences" in words


def test_coverage_of_contact_rests_and_final_poses_stands_beside_errors(page):
    _, results = study()
    row = results["table"]["disc"]["learnt"]
    shares = [f"{100 * row[f'{kind}_inside_95']:.0f} %" for kind in ("contact", "rest", "final")]
    assert f"{', '.join(shares)} ({row['nees']['mean']:.1f}) silently wrong 1 % ambiguous 20 %" in page.words
    finals = f"({row['final_mm']['worst']:.0f}, {row['final_deg']['worst']:.0f}) in: {shares[2]}"
    assert finals in page.words
    assert "After knocks" not in page.words


def test_worst_errors_and_mean_nees_are_those_of_the_table(tmp_path, words_only):
    trials = drawn_trials(["disc"], METHODS[:1], 2, seconds=2.0)
    results = drawn_results(trials)
    row = results["table"]["disc"]["none"]
    row["final_mm"] = {"median": 1.1, "p75": 12.2, "worst": 23.0}
    row["final_deg"] = {"median": 4.4, "p75": 35.0, "worst": 46.0}
    row["nees"] = {"median": 2.7, "mean": 8.8}
    write_report(tmp_path, results, trials)
    words = Page((tmp_path / "report.html").read_text(encoding="utf-8")).words
    assert "1.1 mm, 4.4° (23, 46) in:" in words
    assert "(8.8) silently wrong" in words


def test_recovery_is_told_where_there_are_knocks(tmp_path, words_only):
    trials = drawn_trials(["disc", "mit"], METHODS[:2], 2, seconds=2.0)
    knocks = {"knocks": 3, "knock_recovery_contact_s": [0.5, 1.0, 2.5], "knock_contact_s": [3.0] * 3}
    errors = {"0.5": [9.0, 8.0, 7.0], "1": [4.0, 3.0, 2.0], "1.5": [2.5] * 3, "2": [1.5] * 3, "3": [None] * 3}
    # Touch learnt on a disc.
    trials[1].summary.update(knocks, knock_error_mm=errors, silently_wrong_unfelt_share=0.03)
    write_report(tmp_path, drawn_results(trials), trials)
    words = Page((tmp_path / "report.html").read_text(encoding="utf-8")).words
    assert "After knocks, by group" in words
    told = "1.00 s, 67 % (3) 8.0, 3.0, 2.5, 1.5, – mm"
    assert f"touch all groups disc mit none – – – learnt {told} {told} –" in words
    assert words.count("silently wrong 1 %, before a touch 3 %") == 2  # of all groups and of the disc


def test_what_went_wrong_is_told(page):
    _, results = study()
    words = page.words
    assert results["lost"]
    for lost in results["lost"]:
        assert f"{lost['recording']} {lost['final_mm']:.1f} mm, {lost['final_deg']:.1f}°" in words
    assert "is truncated or damaged (<bad> & worse)" in words  # and so escaped
    assert "a.json.gz: has no images" in words
    assert "frame 7: cannot be solved" in words
    assert "palpate evaluate recordings --out report" in words
    assert "noise.sensor_pose.deviation [0.0001]" in words


def test_origins_are_told_once_for_each_kind(page):
    words = page.words
    assert words.count("simulated by palpate: MuJoCo, disc") == 1
    assert words.count("MIT cpush") == 1


def test_the_other_study_is_compared(page):
    _, results = study()
    change = results["against"]["methods"]["learnt, isam2"]
    assert (change["better"], change["worse"], change["same"]) == (12, 0, 0)
    words = page.words
    medians = change["final_mm"]
    assert f"learnt, isam2 12 12 0 0 {medians['before']:.2f} → {medians['after']:.2f}" in words


def test_study_in_which_nothing_went_to_its_end(tmp_path):
    write_report(tmp_path, drawn_results([]), [])
    assert "nothing to show" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_report_without_truth_and_method_without_runs(tmp_path):
    trials = drawn_trials(["disc"], METHODS[:2], 2, seconds=2.0)
    blind = drawn_trials(["mit"], METHODS[:1], 1, seconds=2.0)
    blind[0].truth[:] = float("nan")
    blind[0].summary.update(
        scored_frames=0, final_translation_error_mm=None, final_rotation_error_deg=None, silently_wrong_share=None
    )
    blind[0].summary.update(translation_rmse_mm=None, rotation_rmse_deg=None)
    write_report(tmp_path, drawn_results([*trials, *blind]), [*trials, *blind])
    assert "mit" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_report_that_cannot_be_written(tmp_path):
    (tmp_path / "figures").write_text("in the way", encoding="utf-8")
    with pytest.raises(FileError, match=r"figures: cannot be written"):
        write_report(tmp_path, drawn_results([]), [])


@pytest.mark.parametrize(("width", "height", "mobile", "narrowest"), [(1280, 800, False, 260), (390, 844, True, 300)])
def test_report_in_a_browser(report, page, browser, width, height, mobile, narrowest):
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": mobile}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    browser.get((report / "report.html").as_uri())
    assert browser.get_log("browser") == []
    assert browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)") == []
    shown = browser.execute_script("return [...document.images].map(i => [i.naturalWidth, i.clientWidth])")
    assert len(shown) == len(page.all("img", "src"))
    assert all(natural > 0 and narrowest <= client <= natural * 1.1 for natural, client in shown)
    overflow = browser.execute_script("return document.scrollingElement.scrollWidth - innerWidth")
    assert overflow <= 0
    beyond = browser.execute_script(
        "return [...document.querySelectorAll('h1, h2, h3, p, figcaption, li, .key, .scroll, .pictures')]"
        ".filter(e => e.getBoundingClientRect().right > innerWidth).map(e => e.textContent.slice(0, 40))"
    )
    assert beyond == []
    small = browser.execute_script(
        "return [...document.querySelectorAll('p, td, th, figcaption, li, .key')]"
        ".filter(e => parseFloat(getComputedStyle(e).fontSize) < 13).length"
    )
    assert small == 0


def test_the_page_of_a_reported_study_is_made_from_its_table(tmp_path):
    trials, results = study()
    write_results(tmp_path, results, trials)
    read, rows = read_reported(tmp_path)
    assert read == json.loads(json.dumps(results))
    assert [(row.recording, row.group, row.method) for row in rows] == [
        (t.recording, t.group, t.method) for t in trials
    ]
    assert all(
        row.summary["final_translation_error_mm"] == pytest.approx(trial.summary["final_translation_error_mm"])
        and row.summary["step_ms"] == pytest.approx(trial.summary["step_ms"])
        for row, trial in zip(rows, trials, strict=True)
    )
    names = [sheet.name for sheet in study_sheets(rows, read)]
    assert names == ["final-translation", "final-rotation", "slid", "against-translation", "against-rotation"]
    write_report(tmp_path, read, rows)
    assert "Final errors" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_reported_study_that_does_not_tell_what_is_ambiguous_is_read(tmp_path, words_only):
    trials, results = study(1)
    for trial in trials:
        del trial.summary["ambiguous_share"]
    for row in (row for rows in results["table"].values() for row in rows.values()):
        del row["ambiguous"], row["step_ms"]["p99"]
    write_results(tmp_path, results, trials)
    read, rows = read_reported(tmp_path)
    write_report(tmp_path, read, rows)
    words = Page((tmp_path / "report.html").read_text(encoding="utf-8")).words
    step_ms = read["table"]["all groups"]["none"]["step_ms"]
    assert f"{step_ms['p50']:.1f}, {step_ms['p95']:.1f} " in words and "ambiguous 20 %" not in words


def test_names_of_a_reported_study_are_as_they_were(tmp_path):
    trials, results = study(1)
    write_results(tmp_path, results, [dataclasses.replace(trials[0], recording="=disc.mcap")])
    assert "'=disc.mcap" in (tmp_path / "sequences.csv").read_text()
    assert read_reported(tmp_path)[1][0].recording == "=disc.mcap"


def test_a_damaged_table_of_a_reported_study_is_named(tmp_path):
    trials, results = study(1)
    write_results(tmp_path, results, trials)
    (tmp_path / "sequences.csv").write_text("recording,group\na.mcap,a\n")
    with pytest.raises(FileError, match=r"sequences\.csv: is not a table of sequences"):
        read_reported(tmp_path)
    (tmp_path / "sequences.csv").write_text("recording,group\na.mcap\n")
    with pytest.raises(FileError, match=r"sequences\.csv: row 2 has 1 cells, expected 2 as in the first"):
        read_reported(tmp_path)
