"""Servers with the types of Nav2 for tests: planner, controller, routes, behaviours, costmaps.

python nav2_servers.py EVENTS CODES: until its input ends. CODES is JSON: by server the error codes
of its first goals, e.g. {"follow_path": [105]}; the other goals succeed. With "drift" the robot
leaves its path after a second; with "detour" no path is valid, and the third one is longer; with
"far" the route starts away from the robot and ends before the goal. The robot moves at 0.5 m/s
along x while it follows a path.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import rclpy
from geometry_msgs.msg import Point, PoseStamped, PoseWithCovarianceStamped
from nav2_msgs.action import (
    BackUp,
    ComputePathThroughPoses,
    ComputePathToPose,
    ComputeRoute,
    DriveOnHeading,
    FollowPath,
    SmoothPath,
    Spin,
    Wait,
)
from nav2_msgs.msg import RouteNode
from nav2_msgs.srv import ClearEntireCostmap, IsPathValid
from nav_msgs.msg import Odometry
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile

KINDS = {
    "compute_path_to_pose": ComputePathToPose,
    "compute_path_through_poses": ComputePathThroughPoses,
    "compute_route": ComputeRoute,
    "smooth_path": SmoothPath,
    "follow_path": FollowPath,
    "spin": Spin,
    "wait": Wait,
    "backup": BackUp,
    "drive_on_heading": DriveOnHeading,
}
SPEED = 0.5  # m/s
LASTS = {"compute_path_to_pose": 0.1, "follow_path": 4.0}  # s; the others 0.3
COSTMAPS = ("local", "global")


class Nav2:
    """A node with all servers. A new goal of the controller replaces the one that runs."""

    def __init__(self, node: Any, events: Any, codes: dict[str, list[int]]) -> None:
        self._events, self._codes = events, codes
        self._newest: dict[str, int] = {}  # number of the last goal, by server
        self._ends: dict[str, float] = {}  # when it is done
        keeps = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._place = node.create_publisher(PoseWithCovarianceStamped, "amcl_pose", keeps)
        self._odometry = node.create_publisher(Odometry, "odom", 1)
        self._x = 0.0  # m
        self._move(0.0)
        group = ReentrantCallbackGroup()
        self._servers = [
            ActionServer(
                node,
                kind,
                name,
                lambda handle, name=name, kind=kind: self._run(name, kind, handle),
                cancel_callback=lambda _: CancelResponse.ACCEPT,
                callback_group=group,
            )
            for name, kind in KINDS.items()
        ]
        for map_name in COSTMAPS:
            node.create_service(
                ClearEntireCostmap,
                f"{map_name}_costmap/clear_entirely_{map_name}_costmap",
                lambda _, response, name=map_name: self._clear(name, response),
                callback_group=group,
            )
        node.create_service(IsPathValid, "is_path_valid", self._valid, callback_group=group)

    def tell(self, event: str) -> None:
        """Writes the time, s, and an event."""
        self._events.write(f"{time.monotonic()} {event}\n")

    def _run(self, name: str, kind: Any, handle: Any) -> Any:
        number = self._newest[name] = self._newest.get(name, 0) + 1
        codes = self._codes.get(name, [])
        result = kind.Result(error_code=codes.pop(0) if codes else 0)
        self.tell(f"{name} {self._about(name, handle.request)}")
        moved = now = time.monotonic()
        end = self._ends.get(name, 0.0)
        if end < now:  # a goal that replaces another one ends when that would
            end = now + (0.3 if result.error_code else LASTS.get(name, 0.3))
        self._ends[name] = end
        while time.monotonic() < end:
            if self._newest[name] != number:
                handle.abort()
                self.tell(f"{name} replaced")
                return result
            if handle.is_cancel_requested:
                handle.canceled()
                self.tell(f"{name} cancelled")
                return result
            if name == "follow_path":
                feedback = FollowPath.Feedback()
                drifts = "drift" in self._codes and end - time.monotonic() < LASTS[name] - 1
                feedback.tracking_feedback.position_tracking_error = float(drifts)
                handle.publish_feedback(feedback)
                self._move((time.monotonic() - moved) * SPEED)
                moved = time.monotonic()
            time.sleep(0.02)
        if result.error_code:
            handle.abort()
            self.tell(f"{name} failed {result.error_code}")
        else:
            self._fill(name, handle.request, result, number)
            handle.succeed()
            self.tell(f"{name} done")
        return result

    def _move(self, distance: float) -> None:
        """Moves the robot, m."""
        self._x += distance
        place, odometry = PoseWithCovarianceStamped(), Odometry()
        place.pose.pose.position.x = self._x
        odometry.twist.twist.linear.x = SPEED if distance else 0.0
        self._place.publish(place)
        self._odometry.publish(odometry)

    def _fill(self, name: str, goal: Any, result: Any, number: int) -> None:
        """Sets the paths of a result; each differs."""
        start, far = self._at(self._x + 0.001 * number), "far" in self._codes
        if name == "compute_path_to_pose":
            poses = [goal.start if goal.use_start else start, goal.goal]
            if "detour" in self._codes and number == 3:
                poses.insert(1, self._at(20.0))
            result.path.poses = poses
        elif name == "compute_path_through_poses":
            result.path.poses = [start, *goal.goals.goals]
        elif name == "compute_route":
            result.path.poses = [self._at(1.0) if far else start]
            result.path.poses += [self._at(2.0), self._at(4.0) if far else goal.goal]
            places = [pose.pose.position for pose in result.path.poses]
            result.route.nodes = [RouteNode(position=place) for place in places]
        elif name == "smooth_path":
            result.path = goal.path

    @staticmethod
    def _at(x: float) -> Any:
        pose = PoseStamped()
        pose.pose.position = Point(x=x)
        return pose

    @staticmethod
    def _about(name: str, goal: Any) -> str:
        """What a goal asks for."""

        def along(poses: Any) -> str:
            return " ".join(f"{round(each.pose.position.x, 1):g}" for each in poses)

        return {
            "compute_path_to_pose": lambda: (
                f"{goal.goal.pose.position.x:g}" if goal.planner_id else "-"
            ),
            "compute_path_through_poses": lambda: along(goal.goals.goals),
            "compute_route": lambda: f"{goal.goal.pose.position.x:g}" if goal.use_poses else "-",
            "smooth_path": lambda: along(goal.path.poses),
            "follow_path": lambda: f"{goal.path.poses[-1].pose.position.x:g}",
            "spin": lambda: f"{goal.target_yaw:.2f}",
            "wait": lambda: f"{goal.time.sec}",
            "backup": lambda: f"{goal.target.x:.1f} {goal.speed:.2f}",
            "drive_on_heading": lambda: (
                f"{goal.target.x:.1f} {goal.speed:.2f} {goal.time_allowance.sec}"
            ),
        }[name]()

    def _clear(self, name: str, response: Any) -> Any:
        self.tell(f"clear {name}")
        response.success = True
        return response

    def _valid(self, request: Any, response: Any) -> Any:
        response.success = True
        response.is_valid = bool(request.path.poses) and "detour" not in self._codes
        return response


if __name__ == "__main__":
    rclpy.init()
    node = rclpy.create_node("nav2_servers")
    with open(sys.argv[1], "a", encoding="utf-8", buffering=1) as file:
        servers = Nav2(node, file, json.loads(sys.argv[2]))
        executor = MultiThreadedExecutor(8)
        executor.add_node(node)
        servers.tell("ready")
        executor.spin()
