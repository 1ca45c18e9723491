"""The untouched gel of recordings that begin in contact."""

import dataclasses

import numpy as np
import pytest
from recording_samples import encoded

from palpate import DIGIT, Disc, Recording
from palpate.pipeline.first_release import release_after_start

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


def gel_found(touches: list[float | None]) -> bool:
    """Tell if the gel is found of a push whose touch is at these columns; at None the sensor is 20 mm back."""
    count = len(touches)
    push = Recording(
        time=5.0 + np.arange(count) / 30,
        sensor_pose=np.array([(-0.04 if at else -0.06, 0.0, 0.0) for at in touches]),
        shape=Disc(0.04),
        sensor=SENSOR,
        image=tuple(image(at, index) for index, at in enumerate(touches)),
    )
    found = release_after_start(push, np.zeros(3), np.full(3, 5e-3), "learnt")
    assert found is None or np.abs(found.background.mean - GEL).mean() < 2.0
    return found is not None


REST: list[float | None] = [None] * 40
HELD: list[float | None] = [20.0] * 40
SLIDING: list[float | None] = [20.0 + 0.5 * index for index in range(40)]


@pytest.mark.parametrize("touch", [HELD, SLIDING, [*REST[:8], *HELD]], ids=["held", "sliding", "soon"])
def test_the_gel_is_taken_from_the_first_release(touch):
    assert gel_found([*touch, *REST, 40.0, *([42.0] * 30), *REST])


@pytest.mark.parametrize(
    "touches",
    [[*REST, *HELD, *REST], [*REST, *SLIDING, *REST, *HELD], [*HELD, *HELD, *HELD], REST, HELD[:20], HELD[:1]],
    ids=["untouched first", "twice", "never let go", "never touched", "short", "one frame"],
)
def test_nothing_is_found_where_none_is_needed_or_none_is_there(touches):
    assert not gel_found(touches)


def test_without_the_object_near_or_without_images_none_is_needed():
    push = Recording(np.arange(3.0), np.zeros((3, 3)), Disc(0.04), SENSOR, image=(image(None, 0),) * 3)
    for first, tactile in (((1.0, 0.0, 0.0), "learnt"), ((0.0, 0.0, 0.0), "none")):
        assert release_after_start(push, np.array(first), np.full(3, 1e-3), tactile) is None
