"""palpate as a node of ROS 2, `python -m palpate.ros2`: a live session whose sources and outlet are topics."""
