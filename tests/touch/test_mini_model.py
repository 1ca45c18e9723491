"""The model of the GelSight Mini that ships: chosen by the profile's name, and what it reads."""

import json
import math

import numpy as np

from palpate.cli.main import main
from palpate.geometry.shapes import Disc, Rectangle
from palpate.lab.simulate.gel import render
from palpate.lab.simulate.unit import draw_unit
from palpate.touch.difference import difference, reduced
from palpate.touch.model import SHIPPED, shipped_model
from palpate.touch.modes import chosen
from palpate.types.sensor import GELSIGHT_MINI

UNITS = [draw_unit(GELSIGHT_MINI, seed) for seed in (100_001, 100_002, 100_003, 100_004)]


def pose(unit, front, tilt, y):
    """object_T_sensor of a pad that faces +x and touches what has its front here, at y on the pad, tilted."""
    center = np.array([front - unit.radius, 0.0])
    along = np.array([-math.sin(tilt), math.cos(tilt)])
    apex = center - y * along + unit.radius * np.array([math.cos(tilt), math.sin(tilt)])
    return np.append(apex, tilt)


def looks(shape, front, tilt, y, depth):
    for unit in UNITS:
        model = shipped_model(unit.profile.name)
        image = render(unit, shape, pose(unit, front, tilt, y), depth)
        bare = render(unit, shape, pose(unit, front - 0.05, 0.0, 0.0), 0.0)
        yield model.look(difference(image, reduced(bare)))


def test_it_is_chosen_by_name():
    model = shipped_model("GelSight Mini")
    assert model.folder != SHIPPED and model.settings.sensor == "GelSight Mini"
    assert (model.settings.image_height, model.settings.image_width) == (240, 320)
    assert shipped_model("my finger").folder == SHIPPED
    assert chosen(UNITS[0].no_contact, GELSIGHT_MINI) == ("learnt", "images fit the touch model of the GelSight Mini")


def test_it_tells_where_a_disc_lies_on_the_pad():
    told = []
    for y in (-0.005, 0.0, 0.005):
        found = [look.place for look in looks(Disc(0.05), -0.05, 0.0, y, 5e-4)]
        told.append(np.mean([place[0] for place in found if place is not None]))
    assert told[0] < told[1] - 0.002 < told[2] - 0.004


def test_it_tells_how_a_side_leans():
    told = []
    for degrees in (-5.0, 0.0, 5.0):
        # The deeper edge of the pad is at the origin's height, so that the side is long enough on both sides.
        found = looks(Rectangle(0.09, 0.2), -0.045, math.radians(degrees), 0.0, 6e-4)
        told.append(np.degrees(np.mean([look.direction[0] for look in found])))
    assert told[0] > told[1] + 2.0 and told[1] > told[2] + 2.0


def test_simulated_and_tracked_by_the_commands(tmp_path, capsys, monkeypatch, no_figures):
    monkeypatch.setattr("palpate.lab.study.report.study_figures", lambda *_: [])
    made = ["simulate", str(tmp_path / "pushes"), "--sensor", "gelsight-mini", "--shape", "disc", "--count", "1"]
    assert main([*made, "--seconds", "3"]) == 0
    assert main(["track", str(tmp_path / "pushes/disc-000000.mcap"), "--out", str(tmp_path / "run")]) == 0
    assert "GelSight Mini" in capsys.readouterr().out
    study = ["evaluate", str(tmp_path / "pushes"), "--out", str(tmp_path / "study"), "--tactile", "learnt"]
    assert main(study) == 0
    assert json.loads((tmp_path / "study/results.json").read_text())["study"]["trials"] == 1
    tuned = ["tune", str(tmp_path / "pushes"), "--out", str(tmp_path / "noise.json"), "--evaluations", "2"]
    assert main(tuned) == 0
