"""A robot as the node sees it, run by the Python that has rclpy: publishes a recording, writes down what comes back.

python robot.py PUSH.mcap HEARD.json: the first frame over and over until an estimate comes, a second without images,
then each frame once. Poses come some frames before their time, so that the node need not guess any.
"""

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import rclpy  # pyright: ignore[reportMissingImports]
from diagnostic_msgs.msg import DiagnosticArray  # pyright: ignore[reportMissingImports]
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped  # pyright: ignore[reportMissingImports]
from rclpy.executors import SingleThreadedExecutor  # pyright: ignore[reportMissingImports]
from sensor_msgs.msg import Image  # pyright: ignore[reportMissingImports]

from palpate import read_recording

RATE, DEPTH, HEIGHT = 60.0, 100, 0.25
"""Frames a second [Hz], messages that ROS keeps, and how high the sensor is in the robot's frame [m]."""
AHEAD, PAUSE = 3, 60
"""Frames that poses come early, and frames without an image."""


class Robot:
    """Its node, what it heard, and the stamps [ns] of the images that it published."""

    def __init__(self, push: str) -> None:
        context = rclpy.Context()
        rclpy.init(context=context)
        self._recording = read_recording(push)
        self._node = rclpy.create_node("robot", context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._images = self._node.create_publisher(Image, "/digit/image_raw", DEPTH)
        self._poses = self._node.create_publisher(PoseStamped, "/robot/sensor_pose", DEPTH)
        self._begin = time.time()
        names = ("poses", "diagnoses", "published")
        self.heard: dict[str, list[Any]] = {name: [] for name in names}
        for topic, type_, hear in (
            ("object_pose_with_covariance", PoseWithCovarianceStamped, self._hear_pose),
            ("diagnostics", DiagnosticArray, self._hear_diagnosis),
        ):
            self._node.create_subscription(type_, f"/palpate/{topic}", hear, DEPTH)

    def run(self) -> None:
        number = 0
        while not self.heard["poses"]:
            self._frame(number, 0, 0)
            number += 1
        first = number + PAUSE
        for pause in range(number, first):
            self._frame(pause, None, max(0, pause + AHEAD - first))
        self.heard["before"] = self.heard["diagnoses"][-1:]
        for index in range(count := len(self._recording)):
            self._frame(first + index, index, min(index + AHEAD, count - 1))
        self._spin_until(time.time() + 1.0)

    def _frame(self, number: int, image: int | None, pose: int) -> None:
        """When its time comes, send the recording's image, and the pose that is due some frames later."""
        self._spin_until(self._begin + number / RATE)
        later = self._stamp(number + AHEAD)
        x, y, theta = self._recording.sensor_pose[pose].tolist()
        placed = PoseStamped()
        set_header(placed, later, "base")
        placed.pose.position.x, placed.pose.position.y, placed.pose.position.z = x, y, HEIGHT
        placed.pose.orientation.z, placed.pose.orientation.w = math.sin(theta / 2), math.cos(theta / 2)
        self._poses.publish(placed)
        if image is not None:
            pixels = self._recording[image].image
            assert pixels is not None
            message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding="bgr8", step=3 * pixels.shape[1])
            set_header(message, self._stamp(number), "digit")
            message.data.frombytes(pixels[:, :, ::-1].tobytes())
            self._images.publish(message)
            self.heard["published"].append([self._stamp(number), image])

    def _stamp(self, number: int) -> int:
        return round((self._begin + number / RATE) * 1e9)

    def _spin_until(self, due: float) -> None:
        while (left := due - time.time()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def _hear_pose(self, message: Any) -> None:
        covariance = message.pose.covariance.tolist()
        numbers = numbers_of(message.pose.pose)
        self.heard["poses"].append([stamp_of(message), message.header.frame_id, numbers, covariance])

    def _hear_diagnosis(self, message: Any) -> None:
        status = message.status[0]
        values = {each.key: each.value for each in status.values}
        self.heard["diagnoses"].append([stamp_of(message), status.level[0], status.message, values])


def set_header(message: Any, stamp: int, frame: str) -> None:
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    message.header.frame_id = frame


def numbers_of(pose: Any) -> list[float]:
    position, turn = pose.position, pose.orientation
    return [position.x, position.y, position.z, turn.x, turn.y, turn.z, turn.w]


def stamp_of(message: Any) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


if __name__ == "__main__":
    robot = Robot(sys.argv[1])
    robot.run()
    Path(sys.argv[2]).write_text(json.dumps(robot.heard))
