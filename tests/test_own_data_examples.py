"""The examples and pages of one's own data, run as a user runs them."""

import re
from pathlib import Path

import pytest
from test_package import EXAMPLES, python

from palpate import io as formats


def test_own_arrays(tmp_path):
    frames, moved = python(str(EXAMPLES / "02_own_arrays.py"), str(tmp_path)).splitlines()
    assert frames == "95 frames, 49 in contact"
    found, true = (float(word) for word in moved.split() if word[0].isdigit())
    assert true > 30.0 and abs(found - true) < 1.5
    assert len(formats.load_recording(tmp_path / "push.mcap")) == 95


def test_own_outline(tmp_path):
    # The warning that tells a scan's noise goes to standard error, where `python` allows nothing.
    script = (
        f"import logging, runpy, sys; logging.disable(); sys.argv[1:] = [{str(tmp_path)!r}]; runpy.run_path({{!r}})"
    )
    lines = python("-c", script.format(str(EXAMPLES / "04_own_outline.py"))).splitlines()
    drawn, typed, scanned, box = (line.split(": ")[1] for line in lines)
    assert drawn == "34.75 cm2, centroid at x 0.0 mm, y 0.0 mm"
    assert typed == "34.75 cm2, centroid at x 35.3 mm, y 23.1 mm"
    assert abs(float(scanned.split()[0]) - 34.75) < 0.1
    assert box.startswith("54.00 cm2")
    assert Path(tmp_path / "outlines.png").stat().st_size > 0


@pytest.mark.parametrize("page", ["own_data", "outlines", "own_sensor", "estimate", "status", "other_measurements"])
def test_the_pages_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (EXAMPLES.parent / "docs" / "guide" / f"{page}.md").read_text()
    snippets = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert snippets
    exec(compile("\n".join(snippets), page, "exec"), {})
