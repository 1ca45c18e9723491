"""The shipped model on presses of a real gel: as docs/study/real_gel.json reports."""

import importlib
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WITHIN = {"correlation": 0.002, "slope": 0.02, "offset_deg": 0.2, "rms_about_line_deg": 0.1, "pairs_rms_deg": 0.2}
"""Less than exchanged colours make of each; mirrored or upturned images turn the correlation's sign."""


def test_real_presses_are_read_as_reported(shared_data, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "scripts")
    script = importlib.import_module("measure_real_gel")
    reported = json.loads((ROOT / "docs/study/real_gel.json").read_text())
    assert list(reported) == list(script.CASES)
    found = script.measured(shared_data / "digit_balls", "as it is", 0)
    for name, margin in WITHIN.items():
        assert found[name] == pytest.approx(reported["as it is"][name], abs=margin), name
    # A side that rolls would move the imprint as the presses do; a constant model is off by all of the change.
    assert found["turns_rms_deg"] < 0.25 * found["constant_pairs_rms_deg"]
    assert found["n"] == 20 and found["in_95_share"] > 0.85
