"""A tree as a node of ROS 2: `islandgp ros2` (docs/ros2.md). Needs `islandgp[ros2]`."""
