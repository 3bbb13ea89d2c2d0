"""Servers of ROS 2 for tests: an action that follows its goal, services, a topic."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from threading import Event, Thread
from typing import Any

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float32
from std_srvs.srv import SetBool, Trigger
from test_msgs.action import Fibonacci
from test_msgs.srv import BasicTypes

SUCCEEDS, FAILS, HANGS, REJECTED = 1, 2, 3, 4  # as the order of a goal
SLOW = 5  # accepted after 1.5 s; then it hangs
NEVER = 6  # accepted after a minute
REFUSES = 7  # hangs, and refuses its cancellation
DEAF = 8  # accepts its cancellation and goes on
BUSY = 9  # answers nothing for 7 s, but gives feedback; then it succeeds
BRAKES = 10  # hangs, and ends 1 s after its cancellation
ACCEPTED_AFTER = {SLOW: 1.5, NEVER: 60.0}  # s


class Servers:
    """A node with an action server, the services `/dock` and `/near`, and `/battery`."""

    def __init__(
        self, name: str = "/drive", tell: Callable[[str], None] = lambda _: None, threads: int = 4
    ) -> None:
        self.cancelled: list[int] = []  # orders of the goals that were cancelled
        self.goals: list[int] = []
        self.near = False
        self.calls: list[str] = []
        self._tell = tell  # of "goal 3", "accepted 3", "cancel 3", "ended 3"
        self._ended = Event()
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node(f"servers_of_{name[1:]}", context=self._context)
        group = ReentrantCallbackGroup()
        self.drive = ActionServer(
            self.node,
            Fibonacci,
            name,
            execute_callback=self._drive,
            goal_callback=self._accept,
            cancel_callback=self._cancel,
            callback_group=group,
        )
        if name == "/drive":
            self.node.create_service(Trigger, "/dock", self._dock, callback_group=group)
            self.node.create_service(SetBool, "/near", self._near, callback_group=group)
            self.node.create_service(BasicTypes, "/echo", self._echo, callback_group=group)
        self.battery = self.node.create_publisher(Float32, "/battery", 1)
        self._executor = MultiThreadedExecutor(threads, context=self._context)
        self._executor.add_node(self.node)
        self._thread = Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def _accept(self, goal: Any) -> Any:
        self.goals.append(goal.order)
        self._tell(f"goal {goal.order}")
        self._ended.wait(ACCEPTED_AFTER.get(goal.order, 0))
        self._tell(f"accepted {goal.order}")
        return GoalResponse.REJECT if goal.order == REJECTED else GoalResponse.ACCEPT

    def _cancel(self, handle: Any) -> Any:
        self._tell(f"cancel {handle.request.order}")
        refuses = handle.request.order == REFUSES
        return CancelResponse.REJECT if refuses else CancelResponse.ACCEPT

    def _drive(self, handle: Any) -> Any:
        order = handle.request.order
        start = time.monotonic()
        duration = {SUCCEEDS: 0.2, FAILS: 0.2, BUSY: 7}.get(order, 600)
        while not self._ended.is_set() and time.monotonic() < start + duration:
            if handle.is_cancel_requested and order != DEAF:
                self._ended.wait(1 if order == BRAKES else 0)
                self.cancelled.append(order)
                handle.canceled()
                self._tell(f"ended {order}")
                return Fibonacci.Result()
            if order == BUSY:
                handle.publish_feedback(Fibonacci.Feedback())
            time.sleep(0.01)
        if self._ended.is_set() or order == FAILS:
            handle.abort()
        else:
            handle.succeed()
        self._tell(f"ended {order}")
        return Fibonacci.Result(sequence=[order, 10 * order])

    def _dock(self, _: Any, response: Any) -> Any:
        self.calls.append("dock")
        response.success = True
        return response

    def _near(self, _: Any, response: Any) -> Any:
        response.success = self.near
        return response

    def _echo(self, request: Any, response: Any) -> Any:
        """The response has the values of the request."""
        for field in response.get_fields_and_field_types():
            setattr(response, field, getattr(request, field))
        self.calls.append(request.string_value)
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


if __name__ == "__main__":  # python ros2_servers.py NAME THREADS EVENTS, until its input ends
    with open(sys.argv[3], "a", encoding="utf-8", buffering=1) as events:

        def tell(event: str) -> None:
            """Write the time, s, and the event."""
            events.write(f"{time.monotonic()} {sys.argv[1]} {event}\n")

        servers = Servers(sys.argv[1], tell, int(sys.argv[2]))
        tell("ready")
        sys.stdin.read()
        servers.close()
