"""Simulated recordings: a drawn sensor pushes an object about in a drawn world, and all of it is kept."""

import json
import zlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from palpate.geometry import se2
from palpate.geometry.shapes import Shape, shape_to_dict
from palpate.lab.simulate.ageing import Ageing, over_time
from palpate.lab.simulate.gel import draw_side, render
from palpate.lab.simulate.pushes import Sequence, draw_sequence, measured
from palpate.lab.simulate.systematic import draw_errors, misstated
from palpate.lab.simulate.unit import SensorUnit, draw_unit
from palpate.parallel import one_thread
from palpate.types.images import encode_image
from palpate.types.recording import Recording, episode_numbers
from palpate.types.sensor import DIGIT, SensorProfile

COUNT = 100_000
"""Most recordings of one object in a folder: the n-th of a folder's seed s has the seed s * COUNT + n of its own."""

_FRAMES = {
    "sensor_pose": "simulated motion capture with drawn noise; exact in extra/sensor_pose_clean",
    "object_pose": "simulated motion capture with drawn noise; exact in extra/object_pose_clean",
    "contact": "contacts of the simulation",
    "extra": "normal_force [N], tangential_force [N] and slip [m/s] towards the sensor's +y, indentation [m], "
    "pad_angle [rad], as in palpate.lab.simulate.world.Motion; shown_angle [rad], that one as images show it",
}
WRONG = ", with systematic errors"
"""What a source says of a recording that has them."""
_KNOCKED = "; knocked, 1 in frames in which a finger pushes the object and 0 in others"


def simulate_recording(
    shape: Shape,
    kind: str,
    seed: int,
    seconds: float = 15.0,
    images: bool = True,
    progress: Callable[[int], None] | None = None,
    unit: int | None = None,
    knocks: bool = False,
    ideal: bool = False,
    sensor: SensorProfile = DIGIT,
) -> Recording:
    """Simulate a sequence of pushes of one kind, one of `places.kinds(shape)`, by a DIGIT or another sensor.

    World, sensor unit, pushes and noise are drawn from seed, shape and kind; the same give the same, whether with
    images or not; with a seed of its own, `unit`, the sensor unit is the same in many recordings. The recording's
    sensor is the profile as its maker has it, not the unit: nobody measures each gel. With `knocks` someone shoves the
    object now and then, and extra/knocked says when.
    Mounting, outline, time and first pose are stated with the errors of a real set-up, and gel and light change while
    they are used, see `systematic`; an `ideal` recording has noise alone.
    `progress` is called with the number of images made, which take most of the time. Raises SettingError on a kind or
    duration that is not allowed.
    """
    unit_seed, *seeds = _seeds(shape, kind, seed, unit)
    pushes, noise, camera, shoves, wrong = (np.random.default_rng(each) for each in seeds)
    errors = None if ideal else draw_errors(wrong)
    ageing = errors.ageing if errors else None
    sensor_unit = draw_unit(sensor, unit_seed)
    with one_thread():
        gel = replace(sensor, radius=sensor_unit.radius)
        drift = errors.gel_drift if errors else (0.0, 0.0)
        sequence = draw_sequence(shape, kind, gel, pushes, seconds, shoves if knocks else None, drift)
        pictures = _pictures(sensor_unit, ageing, shape, sequence, camera, progress) if images else None
    motion = sequence.motion
    exact = Recording(
        time=sequence.time,
        sensor_pose=measured(sequence.sensor_pose, noise),
        shape=shape,
        sensor=sensor,
        object_pose=measured(motion.object_pose, noise),
        contact=motion.contact,
        episode=episode_numbers(motion.contact),
        image=pictures,
        source=simulated_source(shape, kind, seed, seconds, images, unit, knocks, ideal, sensor),
        frames=_FRAMES | {"extra": _FRAMES["extra"] + _KNOCKED} if knocks else _FRAMES,
        extra={
            "normal_force": motion.normal_force,
            "tangential_force": motion.tangential_force,
            "slip": motion.slip,
            "indentation": motion.indentation,
            "pad_angle": motion.pad_angle,
            "shown_angle": sensor_unit.shown_angle(motion.pad_angle),
            "sensor_pose_clean": sequence.sensor_pose,
            "object_pose_clean": motion.object_pose,
            **({"knocked": motion.knocked.astype(np.float64)} if knocks else {}),
        },
    )
    return misstated(exact, errors) if errors else exact


def simulated_source(
    shape: Shape,
    kind: str,
    seed: int,
    seconds: float = 15.0,
    images: bool = True,
    unit: int | None = None,
    knocks: bool = False,
    ideal: bool = False,
    sensor: SensorProfile = DIGIT,
) -> str:
    """Return the words that say where a simulated recording comes from, and from what it can be made again.

    They name the seed that `palpate simulate` takes, and which of its recordings this is.
    """
    drawn, *_ = _seeds(shape, kind, seed, unit)
    of_folder, number = divmod(seed, COUNT)
    touch = f"drawn touch images of unit {drawn}" if images else f"no touch images, gel of unit {drawn}"
    which = f"{kind}, {float(seconds)!r} s, seed {of_folder}, recording {number}"
    of = "" if sensor == DIGIT else f", {sensor.name}"
    return f"simulated by palpate: MuJoCo, {which}, {touch}{', knocked' * knocks}{of}{'' if ideal else WRONG}"


def _seeds(shape: Shape, kind: str, seed: int, unit: int | None) -> tuple[int, *tuple[np.random.SeedSequence, ...]]:
    """Seeds of unit, pushes, noise, camera, knocks and systematic errors: other ones for each object and kind."""
    what = json.dumps([shape_to_dict(shape), kind]).encode()
    drawn, *others = np.random.SeedSequence([seed, zlib.crc32(what)]).spawn(6)
    return int(drawn.generate_state(1)[0]) if unit is None else unit, *others


def _pictures(
    unit: SensorUnit,
    ageing: Ageing | None,
    shape: Shape,
    sequence: Sequence,
    rng: np.random.Generator,
    progress: Callable[[int], None] | None,
) -> tuple[bytes, ...]:
    motion = sequence.motion
    side = draw_side(rng)
    poses = se2.between(motion.object_pose, sequence.sensor_pose)
    units = over_time(unit, ageing, sequence.time)
    each = zip(units, poses, motion.indentation, motion.tangential_force, strict=True)
    pictures: list[bytes] = []
    for now, *values in each:
        pictures.append(encode_image(render(now, shape, *values, rng=rng, side=side)))
        if progress:
            progress(len(pictures))
    return tuple(pictures)
