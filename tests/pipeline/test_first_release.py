"""The untouched gel of recordings that begin in contact."""

import dataclasses

import numpy as np
import pytest
from recording_samples import encoded

from palpate import DIGIT, Disc, Recording
from palpate.pipeline.first_release import first_release

SENSOR = dataclasses.replace(DIGIT, name="small", image_height=80, image_width=60)
ROWS, COLUMNS = np.indices((80, 60))
TEXTURE = np.random.default_rng(0).normal(0.0, 4.0, (20, 15)).repeat(4, axis=0).repeat(4, axis=1)
GEL = TEXTURE[..., None] + (90, 120, 150)


def image(at: float | None, seed: int) -> bytes:
    """What is seen of the gel, with an imprint at a column: bright on one side and dark on the other."""
    levels = GEL + np.random.default_rng(seed % 5).normal(0.0, 1.0, GEL.shape)
    if at is not None:
        right, down = (COLUMNS - at) / 8.0, (ROWS - 40.0) / 12.0
        levels = levels * (1.0 + 0.6 * right * np.exp(-(right**2) - down**2))[..., None]
    return encoded(np.clip(levels, 0, 255).astype(np.uint8))


def recording(touches: list[float | None]) -> Recording:
    """A recording whose touch is at these columns, None for none."""
    count = len(touches)
    return Recording(
        time=5.0 + np.arange(count) / 30,
        sensor_pose=np.zeros((count, 3)),
        shape=Disc(0.04),
        sensor=SENSOR,
        image=tuple(image(at, index) for index, at in enumerate(touches)),
    )


REST: list[float | None] = [None] * 40
HELD: list[float | None] = [20.0] * 40
SLIDING: list[float | None] = [20.0 + 0.5 * index for index in range(40)]


@pytest.mark.parametrize("touch", [HELD, SLIDING, [*REST[:8], *HELD]], ids=["held", "sliding", "soon"])
def test_the_gel_is_taken_from_the_first_moment_without_contact(touch):
    lift = first_release(recording([*touch, *REST, 40.0, *([42.0] * 30), *REST]))
    assert lift is not None and len(touch) <= lift <= len(touch) + 15


@pytest.mark.parametrize(
    "touches",
    [[*REST, *HELD, *REST], [*REST, *SLIDING, *REST, *HELD], [*HELD, *HELD, *HELD], REST, HELD[:20]],
    ids=["untouched first", "twice", "never let go", "never touched", "short"],
)
def test_nothing_is_found_where_none_is_needed_or_none_is_there(touches):
    assert first_release(recording(touches)) is None
