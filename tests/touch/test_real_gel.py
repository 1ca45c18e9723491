"""The model that comes along, on presses of a real gel: it reads them as docs/study/real_gel.json says."""

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
    reported = json.loads(script.OUT.read_text())
    assert list(reported) == [*script.ROWS, "flanks"]
    row = "as it is"
    found = script.measured(shared_data / "digit_balls", *script.ROWS[row])
    assert found["n"] == reported[row]["n"]
    for name, margin in WITHIN.items():
        assert found[name] == pytest.approx(reported[row][name], abs=margin), name
    # A side that rolls would move the imprint as the presses do; one that tells none is off by all of them.
    assert found["turns_rms_deg"] < 0.25 * found["constant_pairs_rms_deg"]
    assert found["network_pairs_rms_deg"] < 0.4 * found["constant_pairs_rms_deg"]
    # Where the flanks of the imprints lie is told without a model, and the model reads just that.
    flanks = script.flanks(shared_data / "digit_balls")
    assert flanks == pytest.approx(reported["flanks"], abs=0.01)
    assert flanks["told_over_them_slope"] == pytest.approx(1.0, abs=0.05)
    assert found["pairs_in_68_share"] > 0.4 and found["pairs_in_95_share"] > 0.85
