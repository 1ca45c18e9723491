"""Noise settings in a file."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from palpate import FileError, NoiseSettings, SettingError
from palpate.config import VERSION, noise_of
from palpate_lab.tune.tuning import write_noise

NOISE = NoiseSettings()
CHANGED = replace(
    NOISE,
    contact=replace(NOISE.contact, deviation=2e-3, kernel=None),
    friction_cone=replace(NOISE.friction_cone, share=None),
    priors=replace(NOISE.priors, friction_ratio=(0.1, 0.5)),
)


def written(path: Path, **changes: Any) -> Path:
    content = {"format": "palpate-noise", "version": VERSION, "noise": asdict(CHANGED), "tuned": {}} | changes
    path.write_text(json.dumps(content))
    return path


def test_round_trip(tmp_path):
    for noise in (NOISE, CHANGED):
        write_noise(noise, tmp_path / "noise.json", {"evaluations": 3}, overwrite=True)
        assert noise_of(tmp_path / "noise.json") == noise
    assert json.loads((tmp_path / "noise.json").read_text())["tuned"] == {"evaluations": 3}
    with pytest.raises(FileError, match=r"noise\.json"):
        write_noise(NOISE, tmp_path / "noise.json", {})


def test_missing_settings_have_their_defaults(tmp_path):
    assert noise_of(written(tmp_path / "few.json", noise={"contact": {"deviation": 2e-3, "kernel": None}})) == replace(
        NOISE, contact=CHANGED.contact
    )


def test_the_defaults_or_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert noise_of(str(written(tmp_path / "mine.json"))) == CHANGED
    (tmp_path / "palpate").write_text("not the defaults")
    assert noise_of("palpate") == NOISE
    with pytest.raises(SettingError, match="allowed are 'palpate' or a file of"):
        noise_of("magic")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": None}, "format and version are (None, 4), expected ('palpate-noise', 4)"),
        ({"version": 3}, "('palpate-noise', 3), expected ('palpate-noise', 4); make the file anew with palpate tune"),
        ({"noise": {"contcat": {}}}, "noise has no 'contcat'; known are sensor_pose, first_pose, contact, "),
        ({"noise": {"contact": {"deviaton": 1}}}, "noise contact has no 'deviaton'; known are deviation, kernel"),
        ({"noise": {"contact": 1e-3}}, "noise contact is 0.001, expected an object of settings"),
        ({"noise": {"contact": {"deviation": float("nan")}}}, "contact.deviation is nan; it must be a finite number"),
        ({"noise": {"priors": {"grip": [0.4, 0.0]}}}, "priors.grip is [0.4, 0.0]; it must be a finite mean and"),
    ],
)
def test_a_bad_file_is_refused_in_a_sentence(tmp_path, changes, message):
    with pytest.raises(FileError) as caught:
        noise_of(written(tmp_path / "bad.json", **changes))
    assert str(caught.value).startswith(f"{tmp_path / 'bad.json'}: ")
    assert message in str(caught.value)
