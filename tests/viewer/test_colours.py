"""Colours of views."""

from typing import get_args

from palpate.pipeline.figures import STATUS_COLOURS
from palpate.types.estimate import Status


def test_every_status_has_a_colour():
    assert set(STATUS_COLOURS) == set(get_args(Status))
    assert len(set(STATUS_COLOURS.values())) == len(STATUS_COLOURS)
