"""What a robot's author imports: declarations, the domain interface, and a stepped simulator.

A domain declares in a `Schema` its actions, blackboard keys, counters and rewarded events, and
runs the episodes of trees. The configuration names its class:

    domain: {name: maze, factory: "maze:Maze"}

`SimulatorDomain` is the base class of a domain over a simulator with a step function; other domains
implement `Domain`. `islandgp domain NAME --check` checks a domain against this interface, and
docs/own_domain.md builds one step by step.
"""

from islandgp.bt.core.node import FAILURE as FAILURE
from islandgp.bt.core.node import RUNNING as RUNNING
from islandgp.bt.core.node import SUCCESS as SUCCESS
from islandgp.bt.core.node import Node as Node
from islandgp.bt.core.parameters import Parameter as Parameter
from islandgp.bt.core.parameters import one_of as one_of
from islandgp.bt.core.parameters import real as real
from islandgp.bt.core.parameters import switch as switch
from islandgp.bt.core.parameters import text as text
from islandgp.bt.core.parameters import whole as whole
from islandgp.bt.core.vocabulary import Action as Action
from islandgp.bt.core.vocabulary import Condition as Condition
from islandgp.bt.core.vocabulary import Key as Key
from islandgp.bt.core.vocabulary import Vocabulary as Vocabulary
from islandgp.bt.core.vocabulary import condition_leaf as condition_leaf
from islandgp.bt.core.vocabulary import enumeration as enumeration
from islandgp.bt.core.vocabulary import flag as flag
from islandgp.bt.core.vocabulary import integer as integer
from islandgp.bt.core.vocabulary import number as number
from islandgp.domain.contract import MAX_DELAY as MAX_DELAY
from islandgp.domain.contract import Counter as Counter
from islandgp.domain.contract import Domain as Domain
from islandgp.domain.contract import Event as Event
from islandgp.domain.contract import Observer as Observer
from islandgp.domain.contract import Outcome as Outcome
from islandgp.domain.contract import Scene as Scene
from islandgp.domain.contract import Schema as Schema
from islandgp.domain.contract import Shape as Shape
from islandgp.domain.contract import ShapeStyle as ShapeStyle
from islandgp.domain.contract import png as png
from islandgp.domain.contract import total as total
from islandgp.domain.contract import wants_scenes as wants_scenes
from islandgp.domain.rewards import EventLog as EventLog
from islandgp.domain.rewards import Reward as Reward
from islandgp.domain.rewards import RewardTable as RewardTable
from islandgp.domain.sensors import SensorFaults as SensorFaults
from islandgp.domain.sensors import Sensors as Sensors
from islandgp.domain.simulator import Simulation as Simulation
from islandgp.domain.simulator import SimulatorDomain as SimulatorDomain
from islandgp.leaves import Leaf as Leaf
