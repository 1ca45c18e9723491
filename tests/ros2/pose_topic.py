"""Poses of a topic as `palpate live` takes them, run by the Python that has rclpy: what came of four.

First, which threads one leaves that is closed without having been used.
"""

import threading
import time

import rclpy  # pyright: ignore[reportMissingImports]
from geometry_msgs.msg import PoseStamped  # pyright: ignore[reportMissingImports]

from palpate.live.ros2_topics import ros2_poses
from palpate.live.sources import Clock, TimedPose

rclpy.init()
node = rclpy.create_node("robot")
publisher = node.create_publisher(PoseStamped, "/robot/sensor_pose", 10)
stop = threading.Event()
before = threading.active_count()
unused, close = ros2_poses("/robot/sensor_pose", Clock())
close()
print(threading.active_count() - before)
source, _ = ros2_poses("/robot/sensor_pose", Clock())


def publish() -> None:
    while not publisher.get_subscription_count():
        time.sleep(0.01)
    now = time.time_ns()
    for stamp, height, w in ((now, 0.2, 1.0), (now + 10_000_000, 0.23, 1.0), (0, 0.2, 0.5), (0, 0.205, 1.0)):
        message = PoseStamped()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.header.frame_id = "base"
        message.pose.position.x, message.pose.position.z, message.pose.orientation.w = 0.5, height, w
        publisher.publish(message)


threading.Thread(target=publish, daemon=True).start()
for count, pose in enumerate(source(stop)):
    print(pose.pose.tolist() if isinstance(pose, TimedPose) else pose)
    if count == 3:
        stop.set()
rclpy.shutdown()
