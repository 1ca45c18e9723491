"""What `palpate info` says of a calibration, and `palpate calibrate` of its noise."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate.touch.calibration import Calibration


def show_calibration(path: Path, json: bool) -> None:
    """Print what a calibration holds."""
    from math import degrees

    from palpate.cli.console import print_json, print_table
    from palpate.touch.calibration import load_calibration

    calibration = load_calibration(path)
    height, width = calibration.background.mean.shape[:2]
    noise, view, direction = noise_of(calibration), calibration.view, calibration.direction
    sigma = None if direction.offset_sigma is None else degrees(direction.offset_sigma)
    if json:
        print_json(
            {
                "file": str(path),
                "format": "calibration",
                "height": height,
                "width": width,
                "noise_levels": noise,
                "view": str(view),
                "offset_deg": degrees(direction.offset),
                "offset_sigma_deg": sigma,
                "scale": direction.scale,
                "scale_sigma": direction.scale_sigma,
            }
        )
        return
    lie = str(view) if calibration.is_view_known else "not measured, taken as they are"
    off = "not measured"
    if sigma is not None:
        off = f"{degrees(direction.offset):+.2f} ± {sigma:.2f} degrees and {direction.scale - 1.0:+.1%}"
        off += "" if direction.scale_sigma is None else f" ± {direction.scale_sigma:.1%}"
    rows = [
        ("untouched gel", f"{height} x {width} px"),
        ("noise", noise_words(noise)),
        ("images lie", lie),
        ("directions are off by", off),
    ]
    print_table(str(path), ("what", "value"), rows)


def noise_of(calibration: "Calibration") -> float | None:
    """How much an untouched image changes over time [grey levels], in the median; None where a single one is known."""
    import numpy as np

    deviation = calibration.background.deviation
    return float(np.median(deviation)) if deviation.any() else None


def noise_words(noise: float | None) -> str:
    """The same in words."""
    return "unknown of a single image" if noise is None else f"{noise:.1f} grey levels"
