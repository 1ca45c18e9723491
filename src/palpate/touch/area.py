"""Shrinking images by the mean over areas: what contact detection and the networks see of them."""

import math

import numpy as np
from numpy.typing import NDArray

from palpate.graph.compiled import Records, compiled


def area_means(image: NDArray[np.uint8] | NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float32]:
    """Return the means (rows, columns, 3) of an image (height, width, 3) over areas of equal size.

    Pixels that lie in two areas count in both by their share, as with OpenCV's INTER_AREA, of which this takes half
    the time.
    """
    height, width, channels = image.shape
    out = np.empty((rows, columns, channels), np.float32)
    _put_area_means(np.ascontiguousarray(image).reshape(height, width * channels), channels, out)
    return out


@compiled
def _put_area_means(lines: Records, channels: int, out: Records) -> None:
    height, length = lines.shape
    rows, columns = out.shape[0], out.shape[1]
    down, across = height / rows, length / channels / columns
    line = np.empty(length, np.float32)
    for row in range(rows):
        top, bottom = row * down, (row + 1) * down
        line[:] = np.float32(0.0)
        for y in range(int(top), min(math.ceil(bottom - 1e-9), height)):
            share = np.float32(min(y + 1.0, bottom) - max(float(y), top))
            for i in range(length):  # one long loop, which the compiler turns into vector instructions
                line[i] += share * np.float32(lines[y, i])
        for column in range(columns):
            left, right = column * across, (column + 1) * across
            first, end = int(left), min(math.ceil(right - 1e-9), length // channels)
            for channel in range(channels):
                total = np.float32(0.0)
                for x in range(first, end):
                    share = np.float32((min(x + 1.0, right) - max(float(x), left)) / (down * across))
                    total += share * line[channels * x + channel]
                out[row, column, channel] = total
