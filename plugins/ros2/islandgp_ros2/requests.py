"""Goals of action servers and calls of services, from their start to their confirmed end."""

from __future__ import annotations

from collections import deque
from hashlib import sha256
from secrets import token_bytes
from socket import gethostname
from time import monotonic
from typing import Any, Final

from islandgp_ros2.messages import value_of
from islandgp_ros2.robot_map import ServiceCall

ANSWER_S: Final = 0.5  # most s for which other goals wait for the answer to a cancellation
WATCH_S: Final = 0.5  # between two questions to a server with open goals
_ENDS: Final = {4: "succeeded with", 5: "cancelled", 6: "aborted"}
"""Final states of goals, by action_msgs/msg/GoalStatus."""
_ACTIVE: Final = (1, 2)  # accepted, executing
_UNKNOWN_GOAL, _ENDED_GOAL = 2, 3  # return codes of action_msgs/srv/CancelGoal
_QUESTIONS: Final = 4  # requests for the result of a goal after its server has changed


class Request:
    """A goal or a call of one leaf of the tree."""

    def __init__(
        self, name: str, place: str, uses: tuple[str, ...], limits: tuple[float | None, float]
    ) -> None:
        """Starts its time; `send` sends it.

        Args:
            name: of the action in the tree.
            place: name of the action server or service.
            uses: resources that no other request may use at the same time.
            limits: seconds until it fails (None: no limit), and seconds until it fails without a
                server or without an answer of it.
        """
        self.name, self.place, self.uses = name, place, uses
        self._timeout, self._server_timeout = limits
        self._start = self.since = monotonic()
        self.waits_for = "no server"
        self.is_sent = False
        self.is_cancelled = False
        self.succeeded: bool | None = None
        """True, False, or None while it is open."""
        self.reason = ""  # of a failure
        self.result: Any = None
        self.is_settled = False
        """True: nothing of it runs, as far as its server has confirmed."""
        self.is_given_up = False
        """True: its server does not answer, so it may run."""
        self.obstacle = ""
        """Why it may still run although it was cancelled; "": its server has not answered."""
        self._cancelled_at = 0.0

    def check_time(self) -> None:
        """Fails the request if one of its limits is reached."""
        now = monotonic()
        if not self.is_sent and now - self.since >= self._server_timeout:
            self.fail(f"{self.waits_for} for {self._server_timeout:g} s")
        elif self._timeout is not None and now - self._start >= self._timeout:
            self.fail(f"not done within {self._timeout:g} s")

    @property
    def awaits_answer(self) -> bool:
        """True until the cancellation is answered, at most ANSWER_S seconds."""
        return not self.obstacle and monotonic() - self._cancelled_at < ANSWER_S

    def fail(self, reason: str) -> None:
        """End it for the tree; it may go on at its server."""
        if self.succeeded is None:
            self.succeeded, self.reason = False, f"{self.place}: {reason}"

    def _finish(self, *, succeeded: bool, reason: str = "", result: Any = None) -> None:
        """The server has confirmed the end."""
        self.is_settled = True
        if succeeded and self.succeeded is None:
            self.succeeded, self.result = True, result
        self.fail(reason)


class Call(Request):
    """A call of a service. It cannot be cancelled; its response is then ignored."""

    def __init__(
        self,
        name: str,
        entry: ServiceCall,
        uses: tuple[str, ...],
        client: tuple[Any, str | None],
        message: Any,
    ) -> None:
        """As `Request`; `client`: of the service, and the field with the result, if any."""
        super().__init__(name, entry.service, uses, (entry.timeout, entry.timeout))
        self._client, self._field = client
        self._message = message
        self._answer: Any = None

    @property
    def is_ready(self) -> bool:
        """True if the service is available."""
        return bool(self._client.service_is_ready())

    def send(self) -> None:
        """Calls the service."""
        self.is_sent = True
        self._answer = self._client.call_async(self._message)
        self._answer.add_done_callback(self._on_answer)

    def cancel(self) -> None:
        """Ignores the response from now on."""
        self.is_cancelled = True
        self.is_settled = self.is_settled or not self.is_sent
        self.obstacle = "was called, which cannot be cancelled, and has not answered"

    def give_up(self) -> None:
        """Stops waiting for the response of a cancelled call after its timeout."""
        if monotonic() - self._start >= self._server_timeout:
            self.is_given_up = True
            self._client.remove_pending_request(self._answer)

    def _on_answer(self, answer: Any) -> None:
        result = answer.result()
        succeeded = self._field is None or bool(value_of(result, self._field))
        self._finish(succeeded=succeeded, reason=f"answered {self._field}: false", result=result)


class Goal(Request):
    """A goal of an action server."""

    def __init__(
        self,
        name: str,
        server: Server,
        uses: tuple[str, ...],
        limits: tuple[float | None, float],
        message: Any,
    ) -> None:
        super().__init__(name, server.name, uses, limits)
        self._server, self._message = server, message
        self.id = server.prefix + token_bytes(8)
        self._is_accepted = self._is_cancelling = False
        self._sent_at = 0.0
        self._publishers: set[bytes] = set()  # of the server's state, when the goal was sent
        self._questions = 0
        self._status = 0

    @property
    def is_ready(self) -> bool:
        """True if the action server is available."""
        return self._server.is_ready

    def send(self) -> None:
        """Sends the goal."""
        self.is_sent, self._sent_at = True, monotonic()
        self._publishers = self._server.publishers()
        self._server.goals[self.id] = self
        self._server.send(self.id, self._message, self._on_acceptance)

    def check_time(self) -> None:
        """As for any request; also if the server accepts nothing or does not answer."""
        unanswered = 0.0 if self._is_accepted else monotonic() - self._sent_at
        if self.is_sent and max(self._server.silent_s, unanswered) >= self._server_timeout:
            self.fail(f"no answer for {self._server_timeout:g} s")
        super().check_time()

    def cancel(self) -> None:
        """Cancels the goal, after its acceptance if the server has not accepted it yet."""
        self.is_cancelled, self._cancelled_at = True, monotonic()
        if not self.is_sent:
            self.is_settled = True
        elif self._is_accepted:
            self._server.cancel(self.id, self._on_cancelling)

    def give_up(self) -> None:
        """Stops waiting for the end of a cancelled goal if its server does not answer."""
        waited = 0.0 if self._is_accepted else monotonic() - self._cancelled_at
        if max(self._server.silent_s, waited) >= self._server_timeout:
            self.is_given_up = True
            self._server.goals.pop(self.id, None)

    def watch(self) -> None:
        """Repeats what the server may have missed. Called every WATCH_S seconds."""
        if self.is_cancelled and not self._is_cancelling:
            self._server.cancel(self.id, self._on_cancelling)
        new = self._server.publishers() - self._publishers
        if self._is_accepted and (new or self._status in _ENDS):
            if self._questions < _QUESTIONS:
                self._questions += 1
                self._server.ask_result(self.id, self._on_result)
            elif self._status in _ENDS:  # the answers are lost
                self._end(self._status, None)
            else:
                self._publishers |= new
                self._questions = 0

    def on_status(self, status: int) -> None:
        """Handle the state that the server publishes."""
        self._status = status

    def _on_acceptance(self, answer: Any) -> None:
        self._is_accepted = answer.accepted
        if not answer.accepted:
            self._end(0, None, "rejected the goal")
            return
        self._server.ask_result(self.id, self._on_result)
        if self.is_cancelled:
            self._server.cancel(self.id, self._on_cancelling)

    def _on_cancelling(self, answer: Any) -> None:
        if self.id in [bytes(goal.goal_id.uuid) for goal in answer.goals_canceling]:
            if not self._is_accepted:  # the answer that accepts it is lost
                self._server.ask_result(self.id, self._on_result)
            self._is_accepted = self._is_cancelling = True
            self.obstacle = "accepted the cancellation, and the goal has not ended"
        elif answer.return_code == _UNKNOWN_GOAL and not self._is_accepted:
            self.obstacle = "has neither accepted nor rejected the goal"
        elif answer.return_code in (_UNKNOWN_GOAL, _ENDED_GOAL):
            self._end(0, None)
        else:
            self.obstacle = "refuses to cancel the goal"

    def _on_result(self, answer: Any) -> None:
        if answer.status in _ENDS:
            self._end(answer.status, answer.result)
        else:
            self._end(0, None, "was started again and does not know the goal")

    def _end(self, status: int, result: Any, reason: str = "ended the goal") -> None:
        self._server.goals.pop(self.id, None)
        self._server.ended.append(self.id)
        reason = f"{_ENDS[status]} the goal" if status in _ENDS else reason
        self._finish(succeeded=status == 4, reason=reason, result=result)


class Server:
    """The clients of an action server. While goals are open, it asks whether the server answers."""

    def __init__(self, node: Any, name: str, kind: Any) -> None:
        """Makes the clients.

        Args:
            node: an rclpy Node.
            name: of the action server.
            kind: class of the action.
        """
        from action_msgs.srv import CancelGoal
        from rclpy.clock import Clock, ClockType
        from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_action_status_default

        self._node, self.name, self._log = node, name, node.get_logger()
        parts = {
            "send_goal": kind.Impl.SendGoalService,
            "get_result": kind.Impl.GetResultService,
            "cancel_goal": CancelGoal,
        }
        self._clients = {
            part: node.create_client(service, f"{name}/_action/{part}")
            for part, service in parts.items()
        }
        owner = f"{gethostname()} {node.get_fully_qualified_name()}"
        self.prefix = sha256(owner.encode()).digest()[:8]
        """First half of the IDs of all goals of nodes of this name on this computer."""
        self.goals: dict[bytes, Goal] = {}
        """Sent goals without a confirmed end, by ID."""
        self.ended: deque[bytes] = deque(maxlen=1000)
        """IDs of goals that have ended, whose last state may still come."""
        self.silent_s = 0.0  # s of open goals without an answer
        self._questions: deque[Any] = deque()
        best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        topics = f"{name}/_action"
        node.create_subscription(
            kind.Impl.FeedbackMessage, f"{topics}/feedback", self._hear, best_effort
        )
        node.create_subscription(
            kind.Impl.GoalStatusMessage,
            f"{topics}/status",
            self._on_statuses,
            qos_profile_action_status_default,
        )
        node.create_timer(WATCH_S, self._watch, clock=Clock(clock_type=ClockType.STEADY_TIME))

    @property
    def is_ready(self) -> bool:
        """True if the server is available."""
        return all(client.service_is_ready() for client in self._clients.values())

    def publishers(self) -> set[bytes]:
        """IDs of the publishers of the server's state; a new server has a new one."""
        found = self._node.get_publishers_info_by_topic(f"{self.name}/_action/status")
        return {bytes(each.endpoint_gid) for each in found}

    def send(self, goal_id: bytes, message: Any, on_answer: Any) -> None:
        """Sends a goal."""
        request = self._clients["send_goal"].srv_type.Request(goal=message)
        request.goal_id.uuid = list(goal_id)
        self._call("send_goal", request, on_answer)

    def ask_result(self, goal_id: bytes, on_answer: Any) -> None:
        """Asks for the result of a goal; answered at its end, or at once if it is unknown."""
        request = self._clients["get_result"].srv_type.Request()
        request.goal_id.uuid = list(goal_id)
        self._call("get_result", request, on_answer)

    def cancel(self, goal_id: bytes, on_answer: Any = None) -> Any:
        """Asks to cancel a goal. Returns the future of the answer."""
        request = self._clients["cancel_goal"].srv_type.Request()
        request.goal_info.goal_id.uuid = list(goal_id)
        return self._call("cancel_goal", request, on_answer)

    def _call(self, client: str, request: Any, on_answer: Any) -> Any:
        def answered(future: Any) -> None:
            self._hear()
            if on_answer is not None:
                on_answer(future.result())

        future = self._clients[client].call_async(request)
        future.add_done_callback(answered)
        return future

    def _hear(self, *_: object) -> None:
        self.silent_s = 0.0

    def _watch(self) -> None:
        if not self.goals:
            self.silent_s = 0.0
            return
        self.silent_s += WATCH_S
        self._questions.append(self.cancel(token_bytes(16)))  # of no goal: any server answers it
        if len(self._questions) > 20:
            self._clients["cancel_goal"].remove_pending_request(self._questions.popleft())
        for goal in [*self.goals.values()]:
            goal.watch()

    def _on_statuses(self, message: Any) -> None:
        """Handle the states of all goals; cancels those that a killed node of this name left."""
        self._hear()
        for each in message.status_list:
            goal_id = bytes(each.goal_info.goal_id.uuid)
            if goal_id in self.goals:
                self.goals[goal_id].on_status(each.status)
            elif self._is_left_over(goal_id) and each.status in _ACTIVE:
                self._log.warning(f"{self.name}: a goal left by a node of this name is cancelled")
                self.cancel(goal_id)

    def _is_left_over(self, goal_id: bytes) -> bool:
        return goal_id.startswith(self.prefix) and goal_id not in self.ended
