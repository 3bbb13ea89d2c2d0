"""Actions of a tree as goals of action servers and calls of services."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from time import monotonic
from typing import Any, Final
from uuid import uuid4

from islandgp_ros2.messages import filled, interface, must_have, value_of
from islandgp_ros2.robot_map import ActionServer, ServiceCall

RosLeaf = Callable[..., Generator[None, None, bool]]


_ENDS: Final = {4: "succeeded with", 5: "cancelled", 6: "aborted"}
"""Results of goals, by action_msgs/msg/GoalStatus."""


class RosLeaves:
    """The leaves of a map, by action. Goals of aborted actions are cancelled."""

    def __init__(self, node: Any, entries: Mapping[str, ActionServer | ServiceCall]) -> None:
        """Makes a client for each entry of `node`, an rclpy Node. Raises ConfigError."""
        self._node = node
        self._log = node.get_logger()
        self.cancelling: list[Any] = []
        """Futures of cancellations that have not been answered."""
        self._messages: dict[str, Callable[..., Any]] = {}
        """A function for each action that makes its goal or request from its arguments."""
        self.leaves = {name: self._leaf(name, entry) for name, entry in entries.items()}

    def check(self, calls: Iterable[tuple[str, Mapping[str, object]]]) -> None:
        """Raises ConfigError if the arguments of an action do not fit its goal or request.

        Args:
            calls: the name and the arguments of each leaf; those of other leaves are ignored.
        """
        for name, arguments in calls:
            if name in self._messages:
                self._messages[name](**arguments)

    def _leaf(self, name: str, entry: ActionServer | ServiceCall) -> RosLeaf:
        if isinstance(entry, ActionServer):
            return self._goal(name, entry)
        return self._call(name, entry)

    def _goal(self, name: str, entry: ActionServer) -> RosLeaf:
        from action_msgs.msg import GoalStatus
        from action_msgs.srv import CancelGoal
        from rclpy.action import ActionClient
        from unique_identifier_msgs.msg import UUID

        kind = interface(entry.type)
        place = f"actions.{name}.goal"

        def goal_of(**arguments: object) -> Any:
            return filled(kind.Goal(), {**entry.goal, **arguments}, place)

        goal_of()
        self._messages[name] = goal_of
        client = ActionClient(self._node, kind, entry.action)
        canceller = self._node.create_client(CancelGoal, f"{entry.action}/_action/cancel_goal")

        def run(**arguments: object) -> Generator[None, None, bool]:
            goal = goal_of(**arguments)
            clock = _Clock(entry.timeout, entry.server_timeout)
            while not client.server_is_ready():
                if reason := clock.late(server_is_there=False):
                    return self._failed(name, f"{entry.action}: {reason}")
                yield
            handle = result = None
            clock.server_is_up()
            identity = UUID(uuid=list(uuid4().bytes))
            accepting = client.send_goal_async(goal, goal_uuid=identity)
            self._log.info(f"{name}: goal sent to {entry.action}")
            has_ended = False
            try:
                while not has_ended:
                    if handle is None and accepting.done():
                        handle = accepting.result()
                        if not handle.accepted:
                            has_ended = True
                            return self._failed(name, f"{entry.action} rejected the goal")
                        result = handle.get_result_async()
                    if result is not None and result.done():
                        status = result.result().status
                    else:  # the status topic has the result, too, if the answer is lost
                        status = GoalStatus.STATUS_UNKNOWN if handle is None else handle.status
                    has_ended = status in _ENDS
                    available = handle is not None and client.server_is_ready()
                    if not has_ended and (reason := clock.late(server_is_there=available)):
                        return self._failed(name, f"{entry.action}: {reason}")
                    if not has_ended:
                        yield
                if status == GoalStatus.STATUS_SUCCEEDED:
                    self._log.info(f"{name}: succeeded")
                    return True
                return self._failed(name, f"{entry.action} {_ENDS[status]} the goal")
            finally:
                if not has_ended:
                    request = CancelGoal.Request()
                    request.goal_info.goal_id = identity
                    self._log.info(f"{name}: goal cancelled")
                    self._cancel(canceller, request)
                    if handle is None:  # it may be accepted later
                        accepting.add_done_callback(lambda _: self._cancel(canceller, request))

        return run

    def _cancel(self, canceller: Any, request: Any) -> None:
        """Cancels a goal by its id, as it may run although the answer that accepts it was lost."""
        waiting = [future for future in self.cancelling if not future.done()]
        self.cancelling = [*waiting, canceller.call_async(request)]

    def _call(self, name: str, entry: ServiceCall) -> RosLeaf:
        kind = interface(entry.type)
        place = f"actions.{name}.request"

        def request_of(**arguments: object) -> Any:
            return filled(kind.Request(), {**entry.request, **arguments}, place)

        request_of()
        self._messages[name] = request_of
        response = kind.Response()
        field = entry.success
        if field is not None:
            must_have(response, field, f"actions.{name}.success")
        elif hasattr(response, "success"):
            field = "success"
        client = self._node.create_client(kind, entry.service)

        def run(**arguments: object) -> Generator[None, None, bool]:
            request = request_of(**arguments)
            clock = _Clock(entry.timeout, entry.timeout)
            while not client.service_is_ready():
                if reason := clock.late(server_is_there=False):
                    return self._failed(name, f"{entry.service}: {reason}")
                yield
            answer = client.call_async(request)
            try:
                while not answer.done():
                    if reason := clock.late(server_is_there=client.service_is_ready()):
                        return self._failed(name, f"{entry.service}: {reason}")
                    yield
                if field is None or bool(value_of(answer.result(), field)):
                    self._log.info(f"{name}: succeeded")
                    return True
                return self._failed(name, f"{entry.service} answered {field}: false")
            finally:
                if not answer.done():
                    client.remove_pending_request(answer)

        return run

    def _failed(self, name: str, reason: str) -> bool:
        self._log.warning(f"{name}: failed, {reason}")
        return False


class _Clock:
    """The running time of a leaf, and the time for which its server has been unavailable."""

    def __init__(self, timeout: float | None, server_timeout: float) -> None:
        self._timeout, self._server_timeout = timeout, server_timeout
        self._start = self._last_up = monotonic()

    def server_is_up(self) -> None:
        """Record that the server is available now."""
        self._last_up = monotonic()

    def late(self, *, server_is_there: bool) -> str:
        """The reason why the leaf fails now, or ""."""
        now = monotonic()
        if server_is_there:
            self._last_up = now
        if now - self._last_up >= self._server_timeout:
            return f"no server, or no answer of it, for {self._server_timeout:g} s"
        if self._timeout is not None and now - self._start >= self._timeout:
            return f"not done within {self._timeout:g} s"
        return ""
