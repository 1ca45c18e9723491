"""palpate as a ROS 2 node, `python -m palpate.ros2`: a live session whose sources and results are topics."""
