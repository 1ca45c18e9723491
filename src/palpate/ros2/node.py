"""The node: touch images and sensor poses by topics, tracked as `palpate live` does, and published."""

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from palpate.config import TrackerSettings
from palpate.errors import SettingError
from palpate.lab.simulate.objects import find_shape
from palpate.live.images import pixels_of
from palpate.live.rig import check_size, size_of_images
from palpate.live.ros2 import Ros2Clock, Ros2Node
from palpate.live.ros2_sources import Ros2Images, Ros2Poses
from palpate.live.session import Sources, track_live
from palpate.live.state import LiveState
from palpate.ros2.parameters import Parameters, parameters_of
from palpate.ros2.publisher import Publisher
from palpate.touch.calibration import load_calibration
from palpate.tracker import Tracker
from palpate.types.sensor import DIGIT, SensorProfile

IMAGES, SENSOR_POSES = "image", "sensor_pose"
"""Topics that are subscribed to; a user remaps them."""

_RATED = 16  # images by whose stamps the rate is measured


def run(ros: Ros2Node, stop: threading.Event, say: Callable[[str], Any]) -> LiveState:
    """Track until the event is set; `say` takes what is to be told at once. Returns how it went.

    Raises PalpateError where parameters, topics or images are not what they have to be.
    """
    parameters = parameters_of(ros)
    clock, state = Ros2Clock(ros), LiveState(say)
    images = Ros2Images(ros, IMAGES, clock, clock.epoch)
    poses = Ros2Poses(ros, SENSOR_POSES, clock, clock.epoch, parameters.plane)
    publisher = Publisher(ros, lambda: poses.plane, clock.epoch, state)
    tracker, size = _tracker(parameters, images, stop, say)
    if stop.is_set():
        return state
    say(f"tracking: images of {ros.node.resolve_topic_name(IMAGES)}")
    track_live(tracker, Sources(images.images, poses.poses, clock, size), state, stop, publisher)
    return state


def _tracker(
    parameters: Parameters, images: Ros2Images, stop: threading.Event, say: Callable[[str], Any]
) -> tuple[Tracker, tuple[int, int]]:
    """The tracker of what the parameters say, and the rows and columns of the images as they come."""
    calibration = parameters.calibration and load_calibration(parameters.calibration)
    shape, settings = find_shape(parameters.shape)[1], TrackerSettings(parameters.tactile)
    size = size_of_images(DIGIT, calibration)
    sensor = _measured(DIGIT, size, images, stop, say)
    sigma = parameters.first_pose_sigma
    tracker = Tracker(shape, sensor, parameters.first_pose, settings, calibration=calibration, first_pose_sigma=sigma)
    return tracker, size


def _measured(
    sensor: SensorProfile, size: tuple[int, int], images: Ros2Images, stop: threading.Event, say: Callable[[str], Any]
) -> SensorProfile:
    """The sensor with its rate as the first images show it; SettingError where they have another size."""
    times: list[float] = []
    for image in images.images(stop):
        if isinstance(image, str):
            say(image)
            continue
        check_size("sensor", pixels_of(image, size).shape[:2], size)
        times.append(image.time)
        if len(times) == _RATED:
            break
    if len(times) < _RATED:
        return sensor
    span = times[-1] - times[0]
    if not span > 0.0:
        raise SettingError(f"the stamps of {_RATED} images span {span:g} s; they have to increase")
    return replace(sensor, rate=(_RATED - 1) / span)
