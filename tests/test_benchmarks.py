"""What the benchmarks are fed: no other test runs them, and they are part of what a change of the estimator touches."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from palpate.config import NoiseSettings
from palpate.types.measurements import ContactDirection

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)


def directions(felt):
    return [one.angle for _, said in felt for one in said if isinstance(one, ContactDirection)]


def test_a_push_begins_at_the_apex_of_the_tip():
    felt = directions(importlib.import_module("pushes").make_push(3).felt())
    assert len(felt) == 3
    assert abs(felt[0]) < 0.05  # known to 0.01 rad


def test_a_long_push_is_felt_where_the_tip_leans():
    long, values = importlib.import_module("long"), NoiseSettings().priors.mean
    truth = long.pushed(3, 3, values, np.random.default_rng(0))
    felt = directions(long.felt(truth, values, np.random.default_rng(1)))
    assert len(felt) == 3
    assert np.abs(felt).max() < 0.25  # it leans by up to 0.2 rad
