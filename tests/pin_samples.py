"""A soft dome with white pins inside, as a TacTip has, pressed against a flat wall.

Where the wall meets the dome its skin is flat, and the pins on it, which stand along its normal, turn with it; a camera
behind sees their tips. So B. Ward-Cherrier et al., "The TacTip family", 2018, describe it; what is drawn anew for each
dome is what differs from one to the next. It makes presses to try `palpate train` on, and knows nothing of pushing.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate import SensorProfile

Array = NDArray[np.float64]

PIN_DOME = SensorProfile(name="pin dome", radius=0.02, half_width=0.0173, image_height=240, image_width=320)
"""A dome of 40 mm in which a camera sees all within 60 degrees of the apex."""

_PIN, _BEHIND = 0.004, 0.045  # [m] length of a pin, and of the camera from the apex
_BETWEEN, _LAST = np.radians(11.0), np.radians(58.0)  # from pin to pin, and from the apex to the last ones
_SOFT = 4e-4  # [m] over which the skin goes over into the flat
_SHEAR = 5e-4  # [m] by which the wall may have dragged the skin along
_LEAN = np.radians(3.0)  # standard deviation of the wall's lean up or down
_DEPTH = (5e-4, 2.5e-3)  # [m] of presses
_NOISE = 2.0  # [grey levels]
_SHIFT = 4  # bits of a pixel to which a pin's place is drawn


@dataclass(frozen=True, eq=False)
class PinDome:
    outward: Array  # where pins stand on the skin, seen from the dome's centre: unit vectors (n, 3)
    focus: float  # [px]
    middle: Array  # column and row (2,) [px] of the apex in the image
    pin_size: float  # radius of a pin in the image [px]
    levels: tuple[float, float]  # of the dark inside and of the pins [grey levels]


def draw_dome(seed: int) -> PinDome:
    rng = np.random.default_rng(seed)
    steps = np.arange(-6, 7)
    row, column = np.meshgrid(steps, steps, indexing="ij")
    flat = np.stack([column + 0.5 * (row % 2), row * np.sqrt(0.75)], axis=-1).reshape(-1, 2) * _BETWEEN
    flat = flat[np.hypot(*flat.T) < _LAST] + rng.normal(0.0, 0.01, (np.count_nonzero(np.hypot(*flat.T) < _LAST), 2))
    angle = np.hypot(*flat.T)
    outward = np.column_stack([np.cos(angle), np.sinc(angle / np.pi)[:, None] * flat])
    middle = np.array([159.5, 119.5]) + rng.normal(0.0, 3.0, 2)
    levels = rng.uniform(10.0, 30.0), rng.uniform(180.0, 240.0)
    return PinDome(outward, rng.uniform(250.0, 280.0), middle, rng.uniform(3.0, 4.5), levels)


def press(dome: PinDome, angle: float | None, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return the image (240, 320, 3) of a press at a contact direction [rad]; None is no contact.

    Depth, shear and lean of the wall, and the camera's noise, are drawn.
    """
    import cv2

    skin, normal = PIN_DOME.radius * dome.outward, dome.outward
    if angle is not None:
        lean, depth = rng.normal(0.0, _LEAN), rng.uniform(*_DEPTH)
        wall = np.array([np.cos(angle) * np.cos(lean), np.sin(angle) * np.cos(lean), np.sin(lean)])
        overlap = _SOFT * np.logaddexp(0.0, (skin @ wall - PIN_DOME.radius + depth) / _SOFT)[:, None]
        share = overlap / (overlap + _SOFT)
        drag = rng.uniform(-_SHEAR, _SHEAR, 3)
        skin = skin - overlap * wall + share * (drag - (drag @ wall) * wall)
        normal = normal + share * (wall - normal)
    x, y, z = (skin - _PIN * normal / np.linalg.norm(normal, axis=1, keepdims=True)).T
    away = x - PIN_DOME.radius + _BEHIND
    place = dome.middle + dome.focus * np.column_stack([y, -z]) / away[:, None]
    pins = np.zeros((PIN_DOME.image_height, PIN_DOME.image_width), np.uint8)
    for column, row in np.rint(place * 2**_SHIFT).astype(int).tolist():
        cv2.circle(pins, (column, row), round(dome.pin_size * 2**_SHIFT), 255, cv2.FILLED, cv2.LINE_AA, _SHIFT)
    dark, bright = dome.levels
    image = dark + (bright - dark) / 255.0 * pins + rng.normal(0.0, _NOISE, pins.shape)
    return np.repeat(np.clip(np.rint(image), 0, 255).astype(np.uint8)[..., None], 3, axis=2)
