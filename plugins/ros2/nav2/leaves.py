"""The leaves of Nav2's trees that have no server: they only read and set keys.

The selectors take their default and read no topic. Nothing here knows where the robot is: a path is
as long as it was planned.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from itertools import pairwise
from math import hypot, inf
from time import monotonic
from typing import Any

PLANNER_HELPS = (200, 207, 208)  # unknown, timeout, no valid path
CONTROLLER_HELPS = (100, 104, 105, 106)  # unknown, no patience, no progress, no valid control
_seen: dict[str, Any] = {}  # the goal or the path that each leaf has seen


def ControllerSelector(default_controller: str, **_: object) -> dict[str, str]:
    return {"selected_controller": default_controller}


def PlannerSelector(default_planner: str, **_: object) -> dict[str, str]:
    return {"selected_planner": default_planner}


def GoalCheckerSelector(default_goal_checker: str, **_: object) -> dict[str, str]:
    return {"selected_goal_checker": default_goal_checker}


def ProgressCheckerSelector(default_progress_checker: str, **_: object) -> dict[str, str]:
    return {"selected_progress_checker": default_progress_checker}


def PathHandlerSelector(default_path_handler: str, **_: object) -> dict[str, str]:
    return {"selected_path_handler": default_path_handler}


def GlobalUpdatedGoal(keys: Mapping[str, Any]) -> bool:
    """Whether the goal has changed since the last time; at first it has."""
    return _changed("global", keys["goal"], first=True)


def GoalUpdated(keys: Mapping[str, Any]) -> bool:
    """Whether the goal has changed since the last time; at first it has not."""
    return _changed("local", keys["goal"], first=False)


def WouldAPlannerRecoveryHelp(error_code: int | None) -> bool:
    return error_code in PLANNER_HELPS


def WouldAControllerRecoveryHelp(error_code: int | None) -> bool:
    return error_code in CONTROLLER_HELPS


def TruncatePathLocal(input_path: Any, **_: object) -> dict[str, Any] | bool:
    return input_path is not None and {"output_path": input_path}


def TruncatePath(input_path: Any, **_: object) -> dict[str, Any]:
    return {"output_path": input_path}


def GoalUpdater(input_goal: Any, **_: object) -> dict[str, Any]:
    return {"output_goal": input_goal}


def GoalUpdatedController(keys: Mapping[str, Any]) -> Generator[None, None, bool]:
    """Succeeds at first, and then when the goal changes."""
    while not _changed("controller", keys["goal"], first=True):
        yield
    return True


def PathExpiringTimer(path: Any, seconds: float) -> bool:
    """Whether the path has been the same for some seconds; the time then starts again."""
    now = monotonic()
    if _changed("path", path, first=True) or "since" not in _seen:
        _seen["since"] = now
    is_old = now - _seen["since"] >= float(seconds)
    if is_old:
        _seen["since"] = now
    return bool(is_old)


def IsWithinPathTrackingBounds(
    tracking_feedback: Any,
    max_error_left: float = inf,
    max_error_right: float = inf,
    max_error_heading: float = inf,
    **_: object,
) -> bool:
    """Whether the controller's last feedback is within the bounds; without any it is."""
    if tracking_feedback is None:
        return True
    left = tracking_feedback.position_tracking_error  # m
    within = -float(max_error_right) <= left <= float(max_error_left)
    heading = abs(tracking_feedback.heading_tracking_error)  # rad
    return bool(within and heading <= float(max_error_heading))


def IsGoalNearby(path: Any, proximity_threshold: float, **_: object) -> bool:
    """Whether the path is short."""
    points = [each.pose.position for each in path.poses] if path else []
    length = sum(hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(points))
    return bool(points) and length < float(proximity_threshold)


def _changed(name: str, goal: Any, *, first: bool) -> bool:
    changed = goal != _seen[name] if name in _seen else first
    _seen[name] = goal
    return bool(changed)
