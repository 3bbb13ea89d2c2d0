"""Goals of action servers and calls of services, from their start to their confirmed end."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from hashlib import sha256
from secrets import token_bytes
from socket import gethostname
from time import monotonic
from typing import Any, Final

from islandgp_ros2.actions import RosAction
from islandgp_ros2.messages import value_of

ANSWER_S: Final = 0.5  # most s for which other goals wait for the answer to a cancellation
WATCH_S: Final = 0.5  # between two questions to a server with open goals
_ENDS: Final = {4: "succeeded with", 5: "cancelled", 6: "aborted"}
"""Final states of goals, by action_msgs/msg/GoalStatus."""
_ACTIVE: Final = (1, 2)  # accepted, executing
_UNKNOWN_GOAL, _CANCELLED_BEFORE = 2, 3
"""Return codes of action_msgs/srv/CancelGoal; the second also if the goal has ended."""
_QUESTIONS: Final = 10  # requests for the result of a goal after its server has changed


@dataclass(eq=False)
class Request:
    """A goal or a call of one leaf of the tree, which `send` sends."""

    action: RosAction
    place: str  # name of the action server or service
    client: Any
    message: Any
    uses: tuple[str, ...]  # resources that no other request may use at the same time
    replaces: Request | None = None  # a goal that its server ends when it accepts this one
    waits_for: str = "no server"
    start: float = field(default_factory=monotonic)
    sent_at: float | None = None
    cancelled_at: float | None = None
    is_accepted: bool = False
    is_settled: bool = False  # True: its server has confirmed that nothing of it runs
    succeeded: bool | None = None  # None: it is open
    reason: str = ""  # of a failure
    result: Any = None  # of the server, also after a failure
    feedback: Any = None  # the last one
    obstacle: str = ""
    """Why it may still run although it was cancelled; "": its server has not answered."""

    def check_time(self) -> None:
        """Fails the request if one of its limits is reached."""
        waited, limits = monotonic() - self.start, self.action.entry
        if self.sent_at is None and waited >= limits.server_timeout:
            self.fail(f"{self.waits_for} for {limits.server_timeout:g} s")
        elif limits.timeout is not None and waited >= limits.timeout:
            self.fail(f"not done within {limits.timeout:g} s")

    @property
    def awaits_answer(self) -> bool:
        """True until the cancellation is answered, at most ANSWER_S seconds."""
        waits = self.cancelled_at is not None and monotonic() - self.cancelled_at < ANSWER_S
        return waits and not self.obstacle

    def fail(self, reason: str) -> None:
        """End it for the tree; it may go on at its server."""
        if self.succeeded is None:
            self.succeeded, self.reason = False, f"{self.place}: {reason}"

    def _finish(self, *, succeeded: bool, reason: str, result: Any = None) -> None:
        """The server has confirmed the end."""
        self.is_settled = True
        if self.succeeded is None:
            self.result = result
            self.succeeded = succeeded or None
        self.fail(reason)


@dataclass(eq=False)
class Call(Request):
    """A call of a service. It cannot be cancelled; its response is then ignored."""

    answer: Any = None

    def send(self) -> None:
        """Calls the service."""
        self.sent_at = monotonic()
        self.answer = self.client.call_async(self.message)
        self.answer.add_done_callback(self._on_answer)

    def cancel(self) -> None:
        """Ignores the response from now on."""
        self.obstacle = "was called, which cannot be cancelled, and has not answered"

    def gives_up(self) -> bool:
        """Whether the response of a cancelled call is waited for no longer, after its timeout."""
        is_late = monotonic() - self.start >= self.action.entry.server_timeout
        if is_late:
            self.client.remove_pending_request(self.answer)
        return is_late

    def _on_answer(self, answer: Any) -> None:
        result = answer.result()
        field = self.action.success
        succeeded = field is None or bool(value_of(result, field))
        self._finish(succeeded=succeeded, reason=f"answered {field}: false", result=result)


@dataclass(eq=False)
class Goal(Request):
    """A goal of an action server."""

    id: bytes = field(init=False)
    is_cancelling: bool = False
    publishers: set[bytes] = field(default_factory=set)  # of the server's state, when it was sent
    questions: int = 0
    status: int = 0  # that the server publishes

    def __post_init__(self) -> None:
        """Draws the ID."""
        self.id = self.client.prefix + token_bytes(8)

    def send(self) -> None:
        """Sends the goal."""
        self.sent_at = monotonic()
        self.publishers = self.client.publishers()
        if not self.client.goals:
            self.client.silent_s = 0.0  # of goals that have been given up
        self.client.goals[self.id] = self
        self.client.ask("send_goal", self.id, self._on_acceptance, goal=self.message)

    def check_time(self) -> None:
        """As for any request; also if the server accepts nothing or does not answer."""
        if self._is_lost(self.sent_at):
            self.fail(f"no answer for {self.action.entry.server_timeout:g} s")
        super().check_time()

    def cancel(self) -> None:
        """Cancels the goal, after its acceptance if the server has not accepted it yet."""
        if self.is_accepted:
            self.client.ask("cancel_goal", self.id, self._on_cancelling)

    def gives_up(self) -> bool:
        """Whether the end of a cancelled goal is waited for no longer: no answer."""
        is_lost = self._is_lost(self.cancelled_at)
        if is_lost:
            self.client.goals.pop(self.id, None)
        return is_lost

    def _is_lost(self, since: float | None) -> bool:
        """Whether the server has not answered, or not accepted the goal, for its time limit."""
        if since is None:
            return False
        unanswered = 0.0 if self.is_accepted else monotonic() - since
        return bool(max(self.client.silent_s, unanswered) >= self.action.entry.server_timeout)

    def watch(self) -> None:
        """Repeats what the server may have missed. Called every WATCH_S seconds."""
        if self.cancelled_at is not None and not self.is_cancelling:
            self.client.ask("cancel_goal", self.id, self._on_cancelling)
        new = self.client.publishers() - self.publishers
        if self.is_accepted and (new or self.status in _ENDS):
            if self.questions < _QUESTIONS:
                self.questions += 1
                self.client.ask("get_result", self.id, self._on_result)
            elif self.status in _ENDS:  # the answers are lost
                self._end(self.status, None)
            else:
                self.publishers |= new
                self.questions = 0

    def _on_acceptance(self, answer: Any) -> None:
        self.is_accepted = answer.accepted
        if not answer.accepted:
            self._end(0, None, "rejected the goal")
            return
        self.client.ask("get_result", self.id, self._on_result)
        if self.cancelled_at is not None:
            self.cancel()

    def _on_cancelling(self, answer: Any) -> None:
        cancelling = self.id in [bytes(goal.goal_id.uuid) for goal in answer.goals_canceling]
        if cancelling or answer.return_code == _CANCELLED_BEFORE:
            if not self.is_accepted or not cancelling:  # an earlier answer may be lost
                self.client.ask("get_result", self.id, self._on_result)
            self.is_accepted = self.is_cancelling = True
            self.obstacle = "accepted the cancellation, and the goal has not ended"
        elif answer.return_code == _UNKNOWN_GOAL and not self.is_accepted:
            self.obstacle = "has neither accepted nor rejected the goal"
        elif answer.return_code == _UNKNOWN_GOAL:
            self._end(0, None)
        else:
            self.obstacle = "refuses to cancel the goal"

    def _on_result(self, answer: Any) -> None:
        if answer.status in _ENDS:
            self._end(answer.status, answer.result)
        else:
            self.client.ask("cancel_goal", self.id)  # another server of this name may know it
            self._end(0, None, "was started again and does not know the goal")

    def _end(self, status: int, result: Any, reason: str = "ended the goal") -> None:
        self.client.goals.pop(self.id, None)
        self.client.ended.append(self.id)
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
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from rclpy.qos import qos_profile_action_status_default as kept

        self._node, self._log = node, node.get_logger()
        self._path = f"{name}/_action"
        impl = kind.Impl
        services = {
            "send_goal": impl.SendGoalService,
            "get_result": impl.GetResultService,
            "cancel_goal": CancelGoal,
        }
        self._clients = {
            part: node.create_client(service, f"{self._path}/{part}")
            for part, service in services.items()
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
        loses = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        feedback, status = f"{self._path}/feedback", f"{self._path}/status"
        node.create_subscription(impl.FeedbackMessage, feedback, self._on_feedback, loses)
        node.create_subscription(impl.GoalStatusMessage, status, self._on_statuses, kept)
        node.create_timer(WATCH_S, self._watch, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def service_is_ready(self) -> bool:
        """True if the server is available."""
        return all(client.service_is_ready() for client in self._clients.values())

    def publishers(self) -> set[bytes]:
        """IDs of the publishers of the server's state; a new server has a new one."""
        found = self._node.get_publishers_info_by_topic(f"{self._path}/status")
        return {bytes(each.endpoint_gid) for each in found}

    def ask(
        self, part: str, goal_id: bytes, on_answer: Any = lambda _: None, **content: Any
    ) -> Any:
        """Sends a request about a goal: "send_goal", "cancel_goal" or "get_result".

        The last is answered at the end of the goal, or at once if it is unknown.
        """
        request = self._clients[part].srv_type.Request(**content)
        about = request.goal_info if part == "cancel_goal" else request
        about.goal_id.uuid = list(goal_id)
        future = self._clients[part].call_async(request)
        future.add_done_callback(self._hear)
        future.add_done_callback(lambda done: on_answer(done.result()))
        return future

    def _hear(self, *_: object) -> None:
        self.silent_s = 0.0

    def _on_feedback(self, message: Any) -> None:
        self._hear()
        if goal := self.goals.get(bytes(message.goal_id.uuid)):
            goal.feedback = message.feedback

    def _watch(self) -> None:
        if not self.goals:
            self.silent_s = 0.0
            return
        self.silent_s += WATCH_S
        nothing = token_bytes(16)  # the ID of no goal: any server answers it
        self._questions.append(self.ask("cancel_goal", nothing))
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
                self.goals[goal_id].status = each.status
            elif goal_id in self.ended or each.status not in _ACTIVE:
                continue
            elif goal_id.startswith(self.prefix):
                self._log.warning(f"{self._path}: cancels a goal that a node of this name has left")
                self.ask("cancel_goal", goal_id)
