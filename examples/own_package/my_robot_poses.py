"""A source of sensor poses of your own: here a robot whose sensor goes straight on, 50 times a second.

`palpate live --camera D20001 --poses my-robot ...` takes it, by the entry point in pyproject.toml.
"""

import time
from collections.abc import Iterator
from itertools import islice

SPEED = 0.02  # [m/s]


def poses() -> Iterator[tuple[float, float, float, float]]:
    """Yield when [s since 1970] the sensor was where: x [m], y [m], theta [rad] of world_T_sensor."""
    begin = time.time()
    while True:
        now = time.time()  # a robot's own time of the reading is better, if its clock is this computer's
        yield now, 0.1 + SPEED * (now - begin), 0.0, 0.0
        time.sleep(0.02)


if __name__ == "__main__":
    for when, x, y, theta in islice(poses(), 3):
        print(f"{when:.3f} s: x {1e3 * x:.1f} mm, y {1e3 * y:.1f} mm, theta {theta:.2f} rad")
