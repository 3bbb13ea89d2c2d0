"""Servers of ROS 2 for tests: an action that follows its goal, services, a topic."""

from __future__ import annotations

import sys
import time
from threading import Event, Thread
from typing import Any

import rclpy
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float32
from std_srvs.srv import SetBool, Trigger
from test_msgs.action import Fibonacci

SUCCEEDS, FAILS, HANGS, REJECTED = 1, 2, 3, 4  # as the order of a goal


class Servers:
    """A node with the action server `/drive`, the services `/dock` and `/near`, and `/battery`."""

    def __init__(self) -> None:
        self.cancelled: list[int] = []  # orders of the goals that were cancelled
        self.goals: list[int] = []
        self.near = False
        self.calls: list[str] = []
        self._ended = Event()
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("servers", context=self._context)
        group = ReentrantCallbackGroup()
        self.drive = ActionServer(
            self.node,
            Fibonacci,
            "/drive",
            execute_callback=self._drive,
            goal_callback=self._accept,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            callback_group=group,
        )
        self.node.create_service(Trigger, "/dock", self._dock, callback_group=group)
        self.node.create_service(SetBool, "/near", self._near, callback_group=group)
        self.battery = self.node.create_publisher(Float32, "/battery", 1)
        self._executor = MultiThreadedExecutor(4, context=self._context)
        self._executor.add_node(self.node)
        self._thread = Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def _accept(self, goal: Any) -> Any:
        from rclpy.action import GoalResponse

        self.goals.append(goal.order)
        return GoalResponse.REJECT if goal.order == REJECTED else GoalResponse.ACCEPT

    def _drive(self, handle: Any) -> Any:
        order = handle.request.order
        end = time.monotonic() + 0.2
        while not self._ended.is_set() and (order == HANGS or time.monotonic() < end):
            if handle.is_cancel_requested:
                self.cancelled.append(order)
                handle.canceled()
                return Fibonacci.Result()
            time.sleep(0.01)
        if self._ended.is_set() or order == FAILS:
            handle.abort()
        else:
            handle.succeed()
        return Fibonacci.Result()

    def _dock(self, _: Any, response: Any) -> Any:
        self.calls.append("dock")
        response.success = True
        return response

    def _near(self, _: Any, response: Any) -> Any:
        response.success = self.near
        return response

    def close(self) -> None:
        """Ends all of it."""
        self._ended.set()
        time.sleep(0.05)
        self._executor.shutdown()
        self._thread.join(5)
        self.drive.destroy()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)


if __name__ == "__main__":  # a server that can be killed; it prints the cancelled goals
    servers = Servers()
    print("ready", flush=True)
    sys.stdin.read()
    print(f"cancelled {servers.cancelled}", flush=True)
    servers.close()
