"""Bags of ROS messages without ROS: containers, what is in them, messages as arrays, and the way to a recording."""
