"""Measure what touch reads on units of every kind after few presses: docs/study/units.json.

    python scripts/measure_units.py [SEED] [--taxim FOLDER] [--kinds flat domes]    # kinds not named stay as they are
    python scripts/measure_units.py [SEED] --pushes    # docs/study/unit_pushes.json
    python scripts/measure_units.py [SEED] --set-up    # docs/study/unit_set_up.json

24 drawn units, half of them GelSight Minis and half DIGITs, differ from the usual ones in lights, pitch, radius, dots,
dirt and camera (`palpate_lab.simulate.any_unit`). Each is read as it is, and after `palpate calibrate --presses` on 3,
5 and 10 balls; scores are of other presses: balls, and sides and corners of objects. Real presses are those of
../shared/data and, if FOLDER is the folder `taxim/calib` of the wheel taxim 1.4.1, its own; their images are no part of
the repository. Errors are of places [mm] on flat pads and of directions [degrees] on domes. Pushes are of objects by
DIGITs with one fault each or, to compare with, none, calibrated on five presses; the same pushes for each kind.
"""

import argparse
import csv
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _common import DATA, STUDY, write
from _common import scores as scores_of_run
from numpy.typing import NDArray

from palpate import DIGIT, GELSIGHT_MINI, Calibration, PalpateError, SensorProfile, TrackerSettings
from palpate.arrays import Image
from palpate.geometry import se2
from palpate.geometry.named_shapes import SHAPES
from palpate.pipeline.track import track
from palpate.touch.background import background_of
from palpate.touch.one_image import ImageReader
from palpate.touch.press_calibration import Presses, learn_from_presses
from palpate.touch.touch_model import shipped_model
from palpate.types.images import CameraView, read_image
from palpate_lab.simulate.any_unit import Faults, draw_faults, through_camera, with_faults
from palpate_lab.simulate.gel import ball_overlap, render, touch_image
from palpate_lab.simulate.recordings import Simulation, plan
from palpate_lab.simulate.unit import SensorUnit
from palpate_lab.train.scores import coverage

Array = NDArray[np.float64]
COUNTS = (0, 3, 5, 10)
"""Presses to calibrate on; fewer than three are refused."""
UNITS = 24
PROFILES = {"flat": GELSIGHT_MINI, "domes": DIGIT}
"""Profiles of drawn units, in turn."""
KINDS = {
    "plain": Faults(),
    "half the view": Faults(pitch=0.64),
    "dots": Faults(has_dots=True),
    "dead LED": Faults(has_dead_light=True),
    "turned": Faults(view=CameraView(2)),
    "mirrored": Faults(view=CameraView(0, True)),
}
"""Kinds of DIGITs that push objects; half the view is half the pad."""
PUSHES = 12
SECONDS = 15.0
"""Length of a recording of pushes [s]."""
WANTED_MM = 3.0
"""Final error of a push that is wanted at most."""
BALLS = 12
SIDES = 12
"""Presses of a drawn unit that are read, with BALLS: sides and corners of objects."""


@dataclass(frozen=True, eq=False)
class Pressed:
    """Presses of one unit, as its camera gives them."""

    sensor: SensorProfile
    """Profile of the unit."""
    untouched: Image
    """Its untouched gel."""
    images: list[Image]
    """Each (height, width, 3) RGB."""
    true: Array
    """True place [m] or, on a dome, direction [rad] of each, (N,)."""
    are_from_anywhere: bool = False
    """True if these are measured from an unknown place, so that only changes can be scored."""
    sides: int = 0
    """Count of the last presses that are of sides and corners; the others are of balls."""
    to_calibrate: NDArray[np.int_] | None = None
    """Presses that a calibration may be made on; by default all."""


def main(seed: int, taxim: Path | None, kinds: list[str]) -> None:
    """Measure units of these kinds and write them; what the file has of the other kind stays."""
    found = json.loads((STUDY / "units.json").read_text())
    for kind in kinds:
        profile = PROFILES[kind]
        numbers = range(UNITS)[list(PROFILES).index(kind) :: len(PROFILES)]
        drawn = [of_drawn_unit(seed, number) for number in numbers]
        real = {name: each for name, each in real_units(taxim).items() if each.sensor == profile}
        found["seeds"][kind] = seed
        found["pooled"] |= {f"{kind}, {part}": pooled(drawn, part) for part in ("balls", "sides")}
        found["real"] |= {name: of_balls(pressed) for name, pressed in real.items()}
        found["drawn"] = [each for each in found["drawn"] if each["sensor"] != profile.name] + drawn
        write("units", found)


def add_pushes(seed: int) -> None:
    """Measure pushes by units with one fault each and write them, each kind once it is done."""
    found: dict[str, Any] = {"seed": seed, "seconds": SECONDS, "kinds": {}}
    for kind, faults in KINDS.items():
        found["kinds"][kind] = pushes_of(faults, seed)
        write("unit_pushes", found)


def add_set_up(seed: int) -> None:
    """Measure pushes by units without a fault, with the errors of a set-up and set up exactly, and write them."""
    found: dict[str, Any] = {"seed": seed, "seconds": SECONDS, "kinds": {}}
    for kind, ideal in {"errors": False, "exact": True}.items():
        found["kinds"][kind] = pushes_of(KINDS["plain"], seed, ideal)
        write("unit_set_up", found)


def pushes_of(faults: Faults, seed: int, ideal: bool = False) -> dict[str, Any]:
    """Return the scores of pushes of objects with DIGITs of one kind, each calibrated on five presses."""
    count = -(-PUSHES // len(SHAPES))
    drawn = plan(SHAPES, count, seed, seconds=SECONDS, faults=faults, ideal=ideal)
    plans = list(drawn.values())[:PUSHES]
    found = [pushed(replace(each, unit=seed + number), faults) for number, each in enumerate(plans)]
    tracked = [each for each in found if "refused" not in each]
    return {
        "pushes": len(found),
        "refused": [each["refused"] for each in found if "refused" in each],
        "final_mm": [each["final_mm"] for each in tracked],
        "final_deg": [each["final_deg"] for each in tracked],
        "final_mm_median": float(np.median([each["final_mm"] for each in tracked])),
        "final_mm_worst": max(each["final_mm"] for each in tracked),
        "within_3_mm": sum(each["final_mm"] <= WANTED_MM for each in tracked),
        "in_95_final": float(np.mean([each["inside_final"] for each in tracked])),
        "in_95_contact": float(np.mean([each["inside_contact"] for each in tracked])),
        "silent": float(np.mean([each["silent"] for each in tracked])),
    }


def pushed(simulation: Simulation, faults: Faults) -> dict[str, Any]:
    """Return the scores of one push with a unit that is calibrated on five presses, or the refusal."""
    assert simulation.unit is not None
    camera = through_camera(faults)
    rng = np.random.default_rng(simulation.unit)
    pressed = drawn_presses(with_faults(DIGIT, simulation.unit, faults), rng, others=False)
    pressed = replace(pressed, images=list(map(camera, pressed.images)), untouched=camera(pressed.untouched))
    try:
        calibration, _ = calibrated_on(pressed, 5)
        return scores_of_run(track(simulation.run(), TrackerSettings("learnt"), calibration=calibration).summary)
    except PalpateError as error:
        return {"refused": str(error)}


def of_drawn_unit(seed: int, number: int) -> dict[str, Any]:
    """Return faults and scores of a drawn unit, by the seed of the study and its number."""
    rng = np.random.default_rng([seed, number])
    profile = list(PROFILES.values())[number % len(PROFILES)]
    faults = draw_faults(rng)
    unit = with_faults(profile, int(rng.integers(2**31)), faults)
    camera = through_camera(faults)
    pressed = drawn_presses(unit, rng)
    upright = replace(faults, view=type(faults.view)())
    as_delivered = replace(pressed, images=list(map(camera, pressed.images)), untouched=camera(pressed.untouched))
    as_stated = through_camera(upright)  # without presses somebody has to say how images lie
    stated = replace(pressed, images=list(map(as_stated, pressed.images)), untouched=as_stated(pressed.untouched))
    found = scores(stated, (0,)) | scores(as_delivered, COUNTS[1:])
    return {"sensor": profile.name, "faults": {**asdict(faults), "view": str(faults.view)}, "scores": found}


def drawn_presses(unit: SensorUnit, rng: np.random.Generator, others: bool = True) -> Pressed:
    """Return presses of a drawn unit, as it is seen without its camera: those to calibrate on, and others."""
    shown = 0.5 * unit.pitch * unit.no_contact.shape[1]
    reach = 0.75 * min(shown, 0.9 * unit.half_width)
    most = COUNTS[-1]
    along = np.concatenate([np.linspace(-reach, reach, most), rng.uniform(-reach, reach, BALLS * others)])
    images = [pressed_ball(unit, float(y), rng) for y in along]
    angles = rng.uniform(-1.0, 1.0, SIDES * others) * (0.0 if unit.flat_width else np.arcsin(reach / unit.radius))
    corners = rng.uniform(-0.6 * reach, 0.6 * reach, SIDES * others)
    images += [pressed_side(unit, float(angle), float(y), rng) for angle, y in zip(angles, corners, strict=True)]
    if unit.flat_width:
        true = np.concatenate([along, corners])
    else:
        true = np.concatenate([np.arcsin(along / unit.radius), angles])
    return Pressed(
        unit.profile, touch_image(unit, None, rng=rng), images, true, sides=SIDES * others, to_calibrate=np.arange(most)
    )


def pressed_ball(unit: SensorUnit, y: float, rng: np.random.Generator) -> Image:
    """Return an image of a ball pressed in at y on the pad [m]."""
    place = (y, float(rng.uniform(-2e-3, 2e-3)))
    overlap = ball_overlap(unit, float(rng.uniform(2e-3, 5e-3)), place, float(rng.uniform(4e-4, 1e-3)))
    return touch_image(unit, overlap, rng=rng)


def pressed_side(unit: SensorUnit, angle: float, y: float, rng: np.random.Generator) -> Image:
    """Return an image of an object at an angle on a dome's tip [rad], or at y on a flat pad [m].

    It is a disc, or a side of a rectangle; on a flat pad, whose edges a side covers, a corner of it.
    """
    shape = SHAPES[str(rng.choice(["rectangle", "disc"]))]
    normal = 0.25 * np.pi if unit.flat_width and shape is SHAPES["rectangle"] else 0.0
    outline = shape.outline(720) @ (np.cos(normal), np.sin(normal))
    point = shape.outline(720)[int(outline.argmax())] if normal else np.array([outline.max(), 0.0])
    yaw = normal + np.pi - angle
    if unit.flat_width:
        position = point - se2.rotation(yaw) @ np.array([0.0, y])
    else:
        position = point + unit.radius * np.array([np.cos(normal), np.sin(normal)])
        position = position + se2.rotation(yaw) @ np.array([unit.radius, 0.0])
    return render(unit, shape, np.append(position, yaw), float(rng.uniform(4e-4, 1e-3)), rng=rng)


def scores(pressed: Pressed, counts: tuple[int, ...] = COUNTS) -> dict[str, Any]:
    """Return the scores of presses after a calibration on each of these counts of them, or the refusal."""
    found: dict[str, Any] = {}
    for count in counts:
        try:
            calibration, chosen = calibrated_on(pressed, count)
        except PalpateError as error:
            found[str(count)] = {"refused": str(error)}
            continue
        found[str(count)] = scored(pressed, calibration, chosen)
    return found


def of_balls(pressed: Pressed) -> dict[str, Any]:
    """Return the scores of presses that are all of balls, for each count of presses."""
    return {count: found.get("balls", found) for count, found in scores(pressed).items()}


def calibrated_on(pressed: Pressed, count: int) -> tuple[Calibration, NDArray[np.int_]]:
    """Return the calibration of a unit on some of its presses, spread over its width, and which they are."""
    calibration = Calibration(background_of([pressed.untouched]))
    if not count:
        return calibration, np.array([], np.int_)
    among = np.arange(len(pressed.true)) if pressed.to_calibrate is None else pressed.to_calibrate
    order = among[np.argsort(pressed.true[among], kind="stable")]
    chosen = order[np.linspace(0, len(order) - 1, count).astype(int)]
    images = tuple(pressed.images[k] for k in chosen)
    is_flat = pressed.sensor.flat_width > 0.0
    true = pressed.true[chosen]
    presses = Presses(
        images,
        np.full(count, np.nan) if is_flat else true,
        tuple(map(str, chosen)),
        are_relative=is_flat or pressed.are_from_anywhere,
        place=true if is_flat else None,
    )
    model = shipped_model(pressed.sensor.name)
    return learn_from_presses(presses, calibration, pressed.sensor, model)[0], chosen


def scored(pressed: Pressed, calibration: Calibration, chosen: NDArray[np.int_]) -> dict[str, Any]:
    """Return the scores of presses that a calibration is not made on, by what is pressed."""
    reader = ImageReader(pressed.sensor, calibration, shipped_model(pressed.sensor.name))
    among = np.arange(len(pressed.true))
    left = np.setdiff1d(among, chosen if pressed.to_calibrate is None else pressed.to_calibrate)
    balls = left[left < len(among) - pressed.sides]
    sides = left[left >= len(among) - pressed.sides]
    parts = {"balls": balls, "sides": sides} if pressed.sides else {"balls": balls}
    return {name: scores_of(pressed, reader, part) for name, part in parts.items()}


def scores_of(pressed: Pressed, reader: ImageReader, left: NDArray[np.int_]) -> dict[str, Any]:
    """Return the scores of some presses."""
    told = [told_of(reader, pressed.images[k]) for k in left]
    felt = np.array([each is not None for each in told])
    measured, sigma = np.array([each for each in told if each]).reshape(-1, 2).T
    true = pressed.true[left][felt]
    error = measured - true
    if pressed.are_from_anywhere:
        error = error - error.mean()
    unit = 1e3 if pressed.sensor.flat_width else float(np.degrees(1.0))
    inside = coverage(error, sigma**2)
    return {
        "n": len(left),
        "felt": int(felt.sum()),
        "median": float(unit * np.median(np.abs(error))),
        "second_worst": float(unit * np.sort(np.abs(error))[-2]),
        "worst": float(unit * np.abs(error).max()),
        "slope": float(np.polyfit(true, measured, 1)[0]),
        "in_68": inside[0.68],
        "in_95": inside[0.95],
        "sigma": float(unit * np.median(sigma)),
    }


def told_of(reader: ImageReader, image: Image) -> tuple[float, float] | None:
    """Return the place [m] or direction [rad] that an image shows, and its sigma; None if refused or untouched."""
    try:
        reading = reader.read(image)
    except PalpateError:
        return None
    return reading.place or reading.direction


def pooled(units: list[dict[str, Any]], part: str) -> dict[str, Any]:
    """Return the scores of units together in balls or sides, for each count of presses."""
    found: dict[str, Any] = {}
    for count in map(str, COUNTS):
        rows = [unit["scores"][count] for unit in units]
        read = [row[part] for row in rows if "refused" not in row]
        slopes = [row["slope"] for row in read]
        found[count] = {
            "units": len(units),
            "refused": len(rows) - len(read),
            "median": float(np.median([row["median"] for row in read])),
            "worst_unit": max(row["median"] for row in read),
            "worst": max(row["worst"] for row in read),
            "slope": float(np.median(slopes)),
            "slope_least": min(slopes),
            "slope_most": max(slopes),
            "in_95": float(np.average([row["in_95"] for row in read], weights=[row["felt"] for row in read])),
            "in_95_worst_unit": min(row["in_95"] for row in read),
            "not_felt": sum(row["n"] - row["felt"] for row in read),
        }
    return found


def real_units(taxim: Path | None) -> dict[str, Pressed]:
    """Return the presses of real units."""
    units = {
        "GelSight Mini": on_pad("mini_balls", "centres.csv", "centre_col_px", "background.png"),
        "gel with dots": on_pad("mini_dots_balls", "truth.csv", "column_px", "untouched.png"),
        "DIGIT, balls": digit_balls(),
        "DIGIT, printer": digit_probes(),
    }
    if taxim is not None:
        units["taxim, GelSight"] = of_taxim(taxim / "gelsight")
        units["taxim, Mini"] = of_taxim(taxim / "gelsight_mini")
    return units


def on_pad(folder: str, table: str, column: str, untouched: str) -> Pressed:
    """Return the balls on a flat pad, whose columns are known."""
    with (DATA / folder / table).open(newline="") as file:
        rows = list(csv.DictReader(file))
    files = [DATA / folder / (row.get("file") or f"{row.get('press')}/gelsight.png") for row in rows]
    true = place_of(np.array([float(row[column]) for row in rows]), GELSIGHT_MINI)
    still = read_image(DATA / folder / untouched)
    return Pressed(GELSIGHT_MINI, still, [read_image(file) for file in files], true)


def place_of(column: Array, sensor: SensorProfile) -> Array:
    """Return the places on a pad [m] that columns (N,) [px] of an image show."""
    return (column - 0.5 * (sensor.image_width - 1)) * (sensor.pixel_pitch or 0.0)


def digit_balls() -> Pressed:
    """Return balls on a DIGIT; angles follow from their columns by the scale that the unit's owner states."""
    folder = DATA / "digit_balls"
    with (folder / "truth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    column = np.array([float(row["column_px"]) for row in rows])
    owners = replace(DIGIT, pixel_pitch=1e-3 / 19.58)
    true = np.arcsin(place_of(column, owners) / DIGIT.radius)
    images = [read_image(folder / row["file"]) for row in rows]
    return Pressed(DIGIT, read_image(folder / "untouched.png"), images, true)


def digit_probes() -> Pressed:
    """Return a printer's presses on a DIGIT, at three places; images are mirrored back, changes alone are known."""
    folder = DATA / "digit_printer_probes"
    with (folder / "probe_data.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))[::3]
    files = [folder / "probe_images" / row["img_name"] for row in rows]
    images = [np.ascontiguousarray(read_image(file)[:, ::-1, ::-1]) for file in files]
    still = np.ascontiguousarray(read_image(folder / "untouched.png")[:, ::-1, ::-1])
    # The imprint moves by 21 / (21 + 2) of what the ball of 2 mm does.
    true = np.arcsin(np.array([6.0 - float(row["x_mm"]) for row in rows]) * 1e-3 / (DIGIT.radius + 2e-3))
    return Pressed(DIGIT, still, images, true, are_from_anywhere=True)


def of_taxim(folder: Path) -> Pressed:
    """Return the presses of a folder of taxim, halved to the size of a GelSight Mini's images."""
    pack = np.load(folder / "dataPack.npz")
    images = [halved(image) for image in pack["imgs"]]
    column = 0.5 * np.asarray(pack["touch_center"], np.float64)[:, 0] - 0.25
    return Pressed(GELSIGHT_MINI, halved(pack["f0"]), images, place_of(column, GELSIGHT_MINI))


def halved(image: Image) -> Image:
    """Return an image (480, 640, 3) BGR as (240, 320, 3) RGB."""
    means = image.reshape(240, 2, 320, 2, 3).mean(axis=(1, 3))
    return np.ascontiguousarray(np.rint(means).astype(np.uint8)[..., ::-1])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("seed", nargs="?", type=int, default=20261502)
    parser.add_argument("--taxim", type=Path)
    parser.add_argument("--kinds", nargs="+", choices=list(PROFILES), default=list(PROFILES))
    parser.add_argument("--pushes", action="store_true")
    parser.add_argument("--set-up", action="store_true")
    arguments = parser.parse_args()
    if arguments.pushes:
        add_pushes(arguments.seed)
    elif arguments.set_up:
        add_set_up(arguments.seed)
    else:
        main(arguments.seed, arguments.taxim, arguments.kinds)
