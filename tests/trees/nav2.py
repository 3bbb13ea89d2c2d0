"""Trees with the shapes of those that Nav2 publishes, in our own words.

Each has the nodes and the ports of its counterpart in nav2_bt_navigator/behavior_trees. A shape is
written as `Tag port=value [children]`; `model` declares its leaves as Nav2's model does, without
types.
"""

from __future__ import annotations

import re
from typing import Final
from xml.sax.saxutils import quoteattr

CONDITIONS: Final = {
    "ArePosesNear", "GlobalUpdatedGoal", "GoalUpdated", "IsPathValid", "IsWithinPathTrackingBounds",
    "PathExpiringTimer", "WouldAControllerRecoveryHelp", "WouldAPlannerRecoveryHelp",
    "WouldARouteRecoveryHelp",
}  # fmt: skip
DECORATORS: Final = {
    "DistanceController", "GoalUpdatedController", "GoalUpdater", "PathLongerOnApproach",
    "SpeedController",
}  # fmt: skip
LIBRARY: Final = {
    "Fallback", "Inverter", "KeepRunningUntilFailure", "PipelineSequence", "RateController",
    "ReactiveFallback", "ReactiveSequence", "RecoveryNode", "RetryUntilSuccessful", "RoundRobin",
    "Sequence", "SequenceWithMemory",
}  # fmt: skip

_PARTS: Final = {
    "SELECT": "ControllerSelector selected_controller={c} topic_name=c default_controller=Mppi "
    "PlannerSelector selected_planner={p} topic_name=p default_planner=Smac",
    "PLAN": "ComputePathToPose goal={goal} path={path} planner_id={p} error_code_id={plan_error}",
    "DRIVE": "FollowPath path={path} controller_id={c} error_code_id={drive_error}",
    "CLEAR1": "ClearEntireCostmap service_name=local/clear",
    "CLEAR2": "ClearEntireCostmap service_name=global/clear",
    "MOVES": "Spin spin_dist=1.57 Wait wait_duration=5.0 BackUp backup_dist=0.3 backup_speed=0.1",
    "ROUND": "ReactiveFallback [ GoalUpdated RoundRobin [ Sequence [ CLEAR1 CLEAR2 ] MOVES ] ]",
    "HELPED": "Sequence [ Fallback [ WouldAControllerRecoveryHelp error_code={drive_error} "
    "WouldAPlannerRecoveryHelp error_code={plan_error} ] ROUND ]",
    "PLANNED": "RecoveryNode number_of_retries=1 [ PLAN Sequence [ "
    "WouldAPlannerRecoveryHelp error_code={plan_error} CLEAR2 ] ]",
    "DRIVEN": "RecoveryNode number_of_retries=1 [ DRIVE Sequence [ "
    "WouldAControllerRecoveryHelp error_code={drive_error} CLEAR1 ] ]",
    "VALID": "ReactiveSequence [ Inverter [ GlobalUpdatedGoal ] IsPathValid path={path} ]",
    "REPLAN": "Fallback [ VALID PLAN ]",
    "MILE1": "ReactiveSequence [ GetCurrentPose current_pose={here} "
    "GetPoseFromPath path={route} index=0 pose={first} "
    "Inverter [ ArePosesNear ref_pose={here} target_pose={first} tolerance=0.3 ] "
    "ComputePathToPose goal={first} path={mile} planner_id={p} "
    "ConcatenatePaths input_path1={mile} input_path2={route} output_path={route} ]",
    "MILE2": "ReactiveSequence [ GetPoseFromPath path={route} index=-1 pose={last} "
    "Inverter [ ArePosesNear ref_pose={goal} target_pose={last} tolerance=0.1 ] "
    "ComputePathToPose start={last} goal={goal} path={mile} planner_id={p} "
    "ConcatenatePaths input_path1={route} input_path2={mile} output_path={route} ]",
    "ROUTE": "ComputeRoute goal={goal} path={route} route={nodes} use_poses=true "
    "error_code_id={route_error}",
    "ROUTED": "Sequence [ Fallback [ WouldARouteRecoveryHelp error_code={route_error} "
    "WouldAPlannerRecoveryHelp error_code={plan_error} ] CLEAR2 ]",
}

SHAPES: Final = {
    "follow_point": "PipelineSequence [ SELECT RateController hz=1.0 [ Sequence [ "
    "GoalUpdater input_goal={goal} output_goal={moved} [ PLAN ] "
    "TruncatePath distance=1.0 input_path={path} output_path={short} ] ] "
    "KeepRunningUntilFailure [ DRIVE ] ]",
    "nav_to_pose_with_consistent_replanning_and_if_path_becomes_invalid":
    "RecoveryNode number_of_retries=6 [ PipelineSequence [ SELECT RateController hz=2.0 [ "
    "RecoveryNode number_of_retries=1 [ Fallback [ ReactiveSequence [ "
    "Inverter [ PathExpiringTimer seconds=10 path={path} ] Inverter [ GlobalUpdatedGoal ] "
    "IsPathValid path={path} ] PLAN ] CLEAR2 ] ] DRIVEN ] ROUND ]",
    "navigate_on_route_graph_w_recovery":
    "RecoveryNode number_of_retries=6 [ PipelineSequence [ SELECT "
    "RecoveryNode number_of_retries=1 [ RateController hz=0.5 [ Fallback [ VALID Sequence [ "
    "ROUTE MILE1 MILE2 SmoothPath unsmoothed_path={route} smoothed_path={path} ] ] ] ROUTED ] "
    "DRIVEN ] HELPED ]",
    "navigate_through_poses_w_replanning_and_recovery":
    "RecoveryNode number_of_retries=6 [ PipelineSequence [ SELECT RateController hz=0.333 [ "
    "RecoveryNode number_of_retries=1 [ ReactiveSequence [ "
    "RemovePassedGoals input_goals={goals} output_goals={goals} radius=0.7 "
    "ComputePathThroughPoses goals={goals} path={path} planner_id={p} ] "
    "Sequence [ WouldAPlannerRecoveryHelp error_code={plan_error} CLEAR2 ] ] ] DRIVEN ] HELPED ]",
    "navigate_to_pose_w_bounds_check":
    "Sequence [ PLAN ReactiveSequence [ "
    "IsWithinPathTrackingBounds max_heading_error=3.14 tracking_feedback={feedback} DRIVE ] ]",
    "navigate_to_pose_w_replanning_and_recovery":
    "RecoveryNode number_of_retries=6 [ PipelineSequence [ SELECT RateController hz=1.0 [ PLANNED ]"
    " DRIVEN ] HELPED ]",
    "navigate_to_pose_w_replanning_goal_patience_and_recovery":
    "RecoveryNode number_of_retries=6 [ PipelineSequence [ SELECT RateController hz=1.0 [ PLANNED ]"
    " ReactiveSequence [ PathLongerOnApproach path={path} prox_len=3.0 length_factor=2.0 [ "
    "RetryUntilSuccessful num_attempts=1 [ SequenceWithMemory [ CancelControl "
    "Wait wait_duration=5.0 ] ] ] DRIVEN ] ] ROUND ]",
    "navigate_w_recovery_and_replanning_only_if_path_becomes_invalid":
    "RecoveryNode number_of_retries=6 [ PipelineSequence [ SELECT RateController hz=1.0 [ "
    "RecoveryNode number_of_retries=1 [ REPLAN CLEAR2 ] ] DRIVEN ] ROUND ]",
    "navigate_w_replanning_distance":
    "PipelineSequence [ SELECT DistanceController distance=1.0 [ PLAN ] DRIVE ]",
    "navigate_w_replanning_only_if_goal_is_updated":
    "PipelineSequence [ SELECT GoalUpdatedController [ PLAN ] DRIVE ]",
    "navigate_w_replanning_only_if_path_becomes_invalid":
    "PipelineSequence [ SELECT RateController hz=1.0 [ REPLAN ] DRIVE ]",
    "navigate_w_replanning_speed":
    "PipelineSequence [ SELECT SpeedController min_rate=0.1 max_rate=1.0 max_speed=0.26 [ PLAN ] "
    "DRIVE ]",
    "navigate_w_replanning_time":
    "PipelineSequence [ SELECT RateController hz=1.0 [ PLAN ] DRIVE ]",
    "navigate_w_routing_global_planning_and_control_w_recovery":
    "RecoveryNode number_of_retries=6 [ PipelineSequence [ SELECT "
    "RecoveryNode number_of_retries=1 [ RateController hz=0.5 [ Fallback [ VALID Sequence [ ROUTE "
    "ExtractRouteNodesAsGoals route={nodes} goals={stops} "
    "AppendGoalPoseToGoals input_goals={stops} output_goals={stops} goal_pose={goal} ] ] ] "
    "Sequence [ Fallback [ WouldARouteRecoveryHelp error_code={route_error} ] CLEAR2 ] ] "
    "RateController hz=1.0 [ RecoveryNode number_of_retries=1 [ Sequence [ "
    "RemovePassedGoals input_goals={stops} output_goals={stops} radius=3.0 "
    "GetNextFewGoals input_goals={stops} num_goals=2 output_goals={next} "
    "ComputePathThroughPoses goals={next} path={path} planner_id={p} ] "
    "Sequence [ WouldAPlannerRecoveryHelp error_code={plan_error} CLEAR2 ] ] ] DRIVEN ] HELPED ]",
    "odometry_calibration":
    "Sequence [ " + "DriveOnHeading dist_to_travel=0.2 speed=0.02 Spin spin_dist=1.57 " * 4 + "]",
    "navigate_through_poses_w_replanning_and_path_adherence":
    "RecoveryNode number_of_retries=6 [ PipelineSequence [ SELECT RateController hz=1.0 [ "
    "RecoveryNode number_of_retries=1 [ Fallback [ ReactiveSequence [ GlobalUpdatedGoal "
    "IsPathValid path={path} ] PLAN ] CLEAR2 ] ] DRIVEN ] HELPED ]",
}  # fmt: skip
"""By the name of the published tree."""


def expanded(shape: str) -> list[str]:
    """The words of a shape, its parts expanded."""
    while parts := [w for w in shape.split() if w in _PARTS]:
        for part in parts:
            shape = re.sub(rf"\b{part}\b", _PARTS[part], shape)
    return shape.split()


def file_of(shape: str) -> str:
    """A file with that tree and the model of its leaves and decorators."""
    lines: list[str] = []
    ports: dict[str, dict[str, None]] = {}
    open_tags: list[str] = []
    tokens = expanded(shape)
    for at, token in enumerate(tokens):
        if token == "]":
            lines.append(f"</{open_tags.pop()}>")
        elif "=" not in token and token != "[":
            rest = tokens[at + 1 :]
            attributes = rest[: next((i for i, w in enumerate(rest) if "=" not in w), len(rest))]
            pairs = [each.split("=") for each in attributes]
            ports.setdefault(token, {}).update(dict.fromkeys(name for name, _ in pairs))
            inner = rest[len(attributes) : len(attributes) + 1] == ["["]
            text = "".join(f" {name}={quoteattr(value)}" for name, value in pairs)
            lines.append(f"<{token}{text}{'' if inner else '/'}>")
            open_tags += [token] if inner else []
    tags = {w: "Condition" if w in CONDITIONS else "Action" for w in ports if w not in LIBRARY}
    model = [
        f'<{"Decorator" if name in DECORATORS else tag} ID="{name}">'
        + "".join(f'<input_port name="{port}">what it is</input_port>' for port in ports[name])
        + f"</{'Decorator' if name in DECORATORS else tag}>"
        for name, tag in tags.items()
    ]
    return "\n".join([
        '<root BTCPP_format="4" main_tree_to_execute="Main">', '<BehaviorTree ID="Main">', *lines,
        "</BehaviorTree>", "<TreeNodesModel>", *model, "</TreeNodesModel>", "</root>",
    ])  # fmt: skip
