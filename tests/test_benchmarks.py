"""The inputs and the gate of the benchmarks, which no other test runs."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from palpate import ContactDirection, NoiseSettings
from palpate.models.pushing.priors import object_prior


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "benchmarks")


def directions(felt):
    return [one.angle for _, measurements in felt for one in measurements if isinstance(one, ContactDirection)]


def test_a_long_push_is_felt_where_the_tip_leans():
    long, values = importlib.import_module("long"), object_prior(NoiseSettings().priors).mean
    truth = long.pushed(3, 3, values, np.random.default_rng(0))
    felt = directions(long.felt(truth, values, np.random.default_rng(1)))
    assert len(felt) == 3 and np.abs(felt).max() < 0.25  # it leans by up to 0.2 rad


def test_the_reference_finds_a_push_and_the_gate_names_a_slow_case():
    pytest.importorskip("gtsam", reason="GTSAM is not installed: pip install 'palpate-lab[paper]'")
    step, graphs = importlib.import_module("step"), importlib.import_module("gtsam_graphs")
    first = np.array([[-0.5 * step.SHAPE.size_x, 0.01, 0.0]])
    objects, sensors = (each[:, 0] for each in step.push(step.MODEL, np.zeros((1, 3)), first, 20, step.Steering()))
    felt = directions(step.felt(objects, sensors))
    assert len(felt) == 21 and abs(felt[0]) < 0.05  # it begins at the apex, known to 0.01 rad
    plain = graphs.PlainGraph(step.MODEL, objects[0])
    pose = [plain.update(given)[0] for given in zip(objects, sensors, strict=True)][-1]
    np.testing.assert_allclose(pose, objects[-1], atol=1e-4)
    slow = [{"name": "graph", "ratio_to_reference": 0.2}, {"name": "new", "ratio_to_reference": 9.0}]
    assert step.failures(slow, [{"name": "graph", "ratio_to_reference": 0.15}]) == []
    (said,) = step.failures(slow, [{"name": "graph", "ratio_to_reference": 0.1}])
    assert said == "graph: ratio to the reference is 0.2, allowed 0.1500"
