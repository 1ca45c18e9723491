"""A study as it is kept without its trials: `results.json` and `sequences.csv`, from which its page can be made."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import FileError
from palpate.files import existing_file, read_json
from palpate.lab.study.rows import read_rows
from palpate.lab.study.trial import Method, Trial
from palpate.pipeline.metrics import PERCENTILES

_WORDS = {"": None, "True": True, "False": False}


def read_reported(folder: Path) -> tuple[dict[str, Any], list[Trial]]:
    """Return the content of `results.json`, and a trial for each row of `sequences.csv`.

    These trials have a summary and no frames. Raises FileError where a file is missing or damaged.
    """
    results, path = read_json(existing_file(folder / "results.json")), existing_file(folder / "sequences.csv")
    try:
        return results, [_trial(row) for row in read_rows(path)]
    except (KeyError, ValueError) as error:
        raise FileError(f"{path}: is not a table of sequences ({error})") from error


def _trial(row: Mapping[str, str]) -> Trial:
    """The trial that `results.flat` made a row of, without frames."""
    about = {name: row[name] for name in ("recording", "group", "tactile", "smoother")}
    summary: dict[str, Any] = {name: _value(text) for name, text in row.items() if name not in about}
    summary["step_ms"] = {share: summary.pop(f"step_ms_{share}") for share in PERCENTILES}
    none, poses = np.empty(0), np.empty((0, 3))
    return Trial(
        recording=about["recording"],
        group=about["group"],
        method=Method(about["tactile"], about["smoother"]),
        time=none,
        truth=poses,
        pose=poses,
        covariance=np.empty((0, 3, 3)),
        contact=np.empty(0, np.bool_),
        sensor_pose=poses,
        slid=none,
        step_ms=none,
        summary=summary,
    )


def _value(text: str) -> float | bool | None:
    return _WORDS[text] if text in _WORDS else float(text)
