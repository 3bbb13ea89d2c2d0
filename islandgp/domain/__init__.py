"""What a robot's author imports: declarations, the domain interface, and a stepped simulator.

A domain declares in a `Schema` its actions, blackboard keys, counters and rewarded events, and
runs the episodes of trees. The configuration names its class:

    domain: {name: maze, factory: "maze:Maze"}

`SimulatorDomain` is the base class of a domain over a simulator with a step function; other domains
implement `Domain`. `islandgp domain NAME --check` checks a domain against this interface, and
docs/own_domain.md builds one step by step.
"""

from islandgp.bt.core.node import FAILURE, RUNNING, SUCCESS, Node
from islandgp.bt.core.parameters import Parameter, one_of, real, switch, text, whole
from islandgp.bt.core.vocabulary import (
    Action,
    Condition,
    Key,
    Vocabulary,
    condition_leaf,
    enumeration,
    flag,
    integer,
    number,
)
from islandgp.domain.contract import (
    MAX_DELAY,
    Counter,
    Domain,
    Event,
    Observer,
    Outcome,
    Scene,
    Schema,
    Shape,
    ShapeStyle,
    png,
    prepare,
    total,
    wants_scenes,
)
from islandgp.domain.event_log import EventLog
from islandgp.domain.rewards import Reward, RewardTable
from islandgp.domain.sensors import SensorFaults, Sensors
from islandgp.domain.simulator import Simulation, SimulatorDomain, once_a_thread
from islandgp.leaves import Leaf

__all__ = [
    "FAILURE",
    "MAX_DELAY",
    "RUNNING",
    "SUCCESS",
    "Action",
    "Condition",
    "Counter",
    "Domain",
    "Event",
    "EventLog",
    "Key",
    "Leaf",
    "Node",
    "Observer",
    "Outcome",
    "Parameter",
    "Reward",
    "RewardTable",
    "Scene",
    "Schema",
    "SensorFaults",
    "Sensors",
    "Shape",
    "ShapeStyle",
    "Simulation",
    "SimulatorDomain",
    "Vocabulary",
    "condition_leaf",
    "enumeration",
    "flag",
    "integer",
    "number",
    "once_a_thread",
    "one_of",
    "png",
    "prepare",
    "real",
    "switch",
    "text",
    "total",
    "wants_scenes",
    "whole",
]
