"""The leaves of Nav2's trees that have no server: they only read and set keys.

The selectors take their default and read no topic. The pose of the robot is a topic, in the frame
of the goals. Paths are not pruned: a path is as long as it was planned.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from itertools import pairwise
from math import hypot, inf
from time import monotonic
from typing import Any

PLANNER_HELPS = (200, 207, 208, 300, 307, 308)  # unknown, timeout, no valid path; the same
ROUTE_HELPS = (400, 404, 405)  # unknown, timeout, no valid route
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
    return _changed("global", _goals(keys), first=True)


def GoalUpdated(keys: Mapping[str, Any]) -> bool:
    """Whether the goal has changed since the last time; at first it has not."""
    return _changed("local", _goals(keys), first=False)


def WouldAPlannerRecoveryHelp(error_code: int | None) -> bool:
    return error_code in PLANNER_HELPS


def WouldAControllerRecoveryHelp(error_code: int | None) -> bool:
    return error_code in CONTROLLER_HELPS


def WouldARouteRecoveryHelp(error_code: int | None) -> bool:
    return error_code in ROUTE_HELPS


def TruncatePathLocal(input_path: Any, **_: object) -> dict[str, Any] | bool:
    return input_path is not None and {"output_path": input_path}


def TruncatePath(input_path: Any, **_: object) -> dict[str, Any]:
    return {"output_path": input_path}


def GoalUpdater(input_goal: Any, **_: object) -> dict[str, Any]:
    return {"output_goal": input_goal}


def GoalUpdatedController(keys: Mapping[str, Any]) -> Generator[None, None, bool]:
    """Succeeds at first, and then when the goal changes."""
    while not _changed("controller", _goals(keys), first=True):
        yield
    return True


def DistanceController(
    keys: Mapping[str, Any], distance: float = 1.0, **_: object
) -> Generator[None, None, bool]:
    """Succeeds at first, and then each time the robot has moved so far, m."""
    here = (yield from _robot(keys)).pose.pose
    while "place" in _seen and _distance(_seen["place"], here) < float(distance):
        yield
        here = keys["robot"].pose.pose
    _seen["place"] = here
    return True


def SpeedController(
    keys: Mapping[str, Any],
    min_rate: float = 0.1,
    max_rate: float = 1.0,
    min_speed: float = 0.0,
    max_speed: float = 0.5,
) -> Generator[None, None, bool]:
    """Succeeds at first, when the goal changes, and then at a rate that rises with the speed."""
    if _changed("speed", _goals(keys), first=True):
        _seen["due"] = monotonic() + 1 / float(max_rate)
        return True
    while monotonic() < _seen["due"] and not _changed("speed", _goals(keys), first=True):
        yield
    share = (keys["robot_speed"] - float(min_speed)) / (float(max_speed) - float(min_speed))
    rate = float(min_rate) + min(max(share, 0), 1) * (float(max_rate) - float(min_rate))
    _seen["due"] = monotonic() + 1 / rate
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
    return bool(path and path.poses) and _length(path) < float(proximity_threshold)


def PathLongerOnApproach(
    path: Any, keys: Mapping[str, Any], prox_len: float = 3.0, length_factor: float = 2.0
) -> bool:
    """Whether a new path to the same goal is much longer than a short one; until a Wait ends."""
    old, waited = _seen.get("approach", (None, keys["waited"]))
    both = old and path and old.poses and path.poses and waited is keys["waited"]
    longer = both and old != path and old.poses[-1].pose == path.poses[-1].pose
    longer = longer and _length(old) < float(prox_len)
    if longer and _length(path) > float(length_factor) * _length(old):
        return True
    _seen["approach"] = path, keys["waited"]
    return False


def GetCurrentPose(keys: Mapping[str, Any], **_: object) -> Generator[None, None, Any]:
    """The pose of the robot, stamped."""
    from geometry_msgs.msg import PoseStamped

    at = yield from _robot(keys)
    return {"current_pose": PoseStamped(header=at.header, pose=at.pose.pose)}


def ArePosesNear(ref_pose: Any, target_pose: Any, tolerance: float = 0.5, **_: object) -> bool:
    """Whether two poses in one frame are near each other, m."""
    known = ref_pose is not None and target_pose is not None
    return known and _distance(ref_pose.pose, target_pose.pose) <= float(tolerance)


def GetPoseFromPath(path: Any, index: float = 0, **_: object) -> dict[str, Any] | bool:
    """The pose of a path; an index below 0 counts from its end."""
    poses = path.poses if path else []
    return -len(poses) <= int(index) < len(poses) and {"pose": poses[int(index)]}


def ConcatenatePaths(input_path1: Any, input_path2: Any, **_: object) -> dict[str, Any] | bool:
    """The path along the first one and then the second one."""
    paths = [path for path in (input_path1, input_path2) if path and path.poses]
    poses = [pose for path in paths for pose in path.poses]
    return bool(poses) and {"output_path": type(paths[0])(header=paths[0].header, poses=poses)}


def ExtractRouteNodesAsGoals(route: Any, **_: object) -> dict[str, Any] | bool:
    """The places of a route as goals."""
    from geometry_msgs.msg import Point, Pose, PoseStamped
    from nav_msgs.msg import Goals

    places = [Point(x=node.position.x, y=node.position.y) for node in route.nodes] if route else []
    goals = [PoseStamped(header=route.header, pose=Pose(position=place)) for place in places]
    return bool(goals) and {"goals": Goals(header=route.header, goals=goals)}


def AppendGoalPoseToGoals(goal_pose: Any, input_goals: Any, **_: object) -> dict[str, Any]:
    return {"output_goals": _with(input_goals, [*input_goals.goals, goal_pose])}


def GetNextFewGoals(input_goals: Any, num_goals: float, **_: object) -> dict[str, Any] | bool:
    few = input_goals.goals[: int(num_goals)] if input_goals else []
    return bool(few) and {"output_goals": _with(input_goals, few)}


def RemovePassedGoals(
    input_goals: Any, keys: Mapping[str, Any], radius: float = 0.5, **_: object
) -> Generator[None, None, Any]:
    """The goals without the first ones that the robot has reached; the last one stays."""
    here = (yield from _robot(keys)).pose.pose
    goals = [*input_goals.goals]
    while len(goals) > 1 and _distance(goals[0].pose, here) <= float(radius):
        del goals[0]
    return {"output_goals": _with(input_goals, goals)}


def _robot(keys: Mapping[str, Any]) -> Generator[None, None, Any]:
    """The message with the pose of the robot; waits for the first one."""
    while keys["robot"] is None:
        yield
    return keys["robot"]


def _with(goals: Any, poses: list[Any]) -> Any:
    return type(goals)(header=goals.header, goals=poses)


def _goals(keys: Mapping[str, Any]) -> tuple[Any, Any]:
    return keys["goal"], keys["goals"]


def _distance(a: Any, b: Any) -> float:
    return hypot(a.position.x - b.position.x, a.position.y - b.position.y)


def _length(path: Any) -> float:
    return sum(_distance(a.pose, b.pose) for a, b in pairwise(path.poses))


def _changed(name: str, goal: Any, *, first: bool) -> bool:
    changed = goal != _seen[name] if name in _seen else first
    _seen[name] = goal
    return bool(changed)
