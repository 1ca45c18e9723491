"""Figures and groups of a study, made by the command."""

import csv
from dataclasses import replace

import cv2
import numpy as np
from recording_samples import pushed

import palpate


def blind() -> palpate.Recording:
    """Return a push without ground truth, of which no figure is drawn."""
    return replace(pushed(20), object_pose=None, first_pose=np.zeros(3))


def test_figures_are_of_the_recordings_with_truth(tmp_path, run_palpate):
    folder, out = tmp_path / "recordings", tmp_path / "out"
    folder.mkdir()
    palpate.write_recording(blind(), folder / "blind-1.mcap")
    words = ("evaluate", folder, "--tactile", "none", "oracle", "--out", out)
    assert run_palpate(*words)[0] == 0 and not (out / "figures").exists()
    for name, frames in (("disc-1.mcap", 40), ("disc-2.mcap", 60), ("edges-1.mcap", 50)):
        palpate.write_recording(pushed(frames), folder / name)
    assert run_palpate(*words, "--resume")[0] == 0
    figures = {path.name: cv2.imread(str(path)) for path in (out / "figures").iterdir()}
    assert set(figures) == {"over-time.png", "final-errors.png"}
    assert all(figure is not None and figure.std() > 5.0 for figure in figures.values())


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
        palpate.write_recording(blind(), tmp_path / "all" / name)
    assert run_palpate("evaluate", tmp_path / "all", "--tactile", "none", "--out", tmp_path / "out")[0] == 0
    table = (tmp_path / "out/sequences.csv").read_text()
    assert {
        row["recording"].strip("'"): row["group"].strip("'") for row in csv.DictReader(table.splitlines())
    } == groups
    assert "'=a+1.mcap,'=a," in table and not [line for line in table.splitlines() if line.startswith("=")]
