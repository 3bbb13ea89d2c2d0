"""A tree as a node of ROS 2: `islandgp ros2` (README.md)."""
