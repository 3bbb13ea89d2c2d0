"""Servers with the types of Nav2 for tests: planner, controller, behaviours, costmaps.

python nav2_servers.py EVENTS CODES: until its input ends. CODES is JSON: by server the error codes
of its first goals, e.g. {"follow_path": [105]}; the other goals succeed. With "drift" the robot
leaves its path after a second.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import BackUp, ComputePathToPose, FollowPath, Spin, Wait
from nav2_msgs.srv import ClearEntireCostmap, IsPathValid
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor

KINDS = {
    "compute_path_to_pose": ComputePathToPose,
    "follow_path": FollowPath,
    "spin": Spin,
    "wait": Wait,
    "backup": BackUp,
}
LASTS = {"compute_path_to_pose": 0.1, "follow_path": 4.0}  # s; the others 0.3
COSTMAPS = ("local", "global")


class Nav2:
    """A node with all servers. A new goal of the controller replaces the one that runs."""

    def __init__(self, node: Any, events: Any, codes: dict[str, list[int]]) -> None:
        self._events, self._codes = events, codes
        self._newest: dict[str, int] = {}  # number of the last goal, by server
        self._ends: dict[str, float] = {}  # when it is done
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
        now, end = time.monotonic(), self._ends.get(name, 0.0)
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
            time.sleep(0.02)
        if result.error_code:
            handle.abort()
            self.tell(f"{name} failed {result.error_code}")
        else:
            if name == "compute_path_to_pose":
                start, goal = PoseStamped(), handle.request.goal
                start.pose.position.x = 0.01 * number  # each path differs
                result.path.poses = [start, goal]
            handle.succeed()
            self.tell(f"{name} done")
        return result

    @staticmethod
    def _about(name: str, goal: Any) -> str:
        """What a goal asks for."""
        return {
            "compute_path_to_pose": lambda: (
                f"{goal.goal.pose.position.x:g}" if goal.planner_id else "-"
            ),
            "follow_path": lambda: f"{goal.path.poses[-1].pose.position.x:g}",
            "spin": lambda: f"{goal.target_yaw:.2f}",
            "wait": lambda: f"{goal.time.sec}",
            "backup": lambda: f"{goal.target.x:.1f} {goal.speed:.2f}",
        }[name]()

    def _clear(self, name: str, response: Any) -> Any:
        self.tell(f"clear {name}")
        response.success = True
        return response

    def _valid(self, request: Any, response: Any) -> Any:
        response.success = True
        response.is_valid = bool(request.path.poses)
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
