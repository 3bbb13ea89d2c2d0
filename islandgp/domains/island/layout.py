"""Indices of the numbers by which Python and compiled code share an episode's state.

They are in one block of memory: `ints`, whole numbers, then `floats`. `ints` has settings,
addresses of Chipmunk's objects and of arrays, and the state of the loop; `floats` has the robot's
heading and settings. Python writes the part `BEFORE` before a call, and reads `AFTER` after it.
"""

from __future__ import annotations

from struct import Struct
from typing import Final

# Settings. MAY_COAST: see kernel.py.
HUMANOIDS, COLUMNS, ASK_FROM, MAX_ITEMS, MAY_COAST, ROCK_COUNT = range(6)
# Addresses. BODIES: the robot and the humanoids; MOTION: x, y, vx and vy of each. CARRIED to
# ASKING_NEAR have a value for each humanoid, ITEM_X to DISCOVERED one for each item of garbage.
SPACE, BODIES, MOTION, TOUCHING, TURN_STEPS, TURN_HUMANOIDS, TURN_VELOCITIES = range(6, 13)
CARRIED, LOOK_STEPS, UNSEEN, ASKING_NEAR = range(13, 17)
ITEM_X, ITEM_Y, PRESENT, DISCOVERED = range(17, 21)
# CELL_ITEMS: items in and around cell c are those from CELL_STARTS[c] to CELL_STARTS[c + 1].
CELL_STARTS, CELL_ITEMS = range(21, 23)
ROCKS = 23  # x, y and radius of each
# State of the loop. CLEAR_UNTIL: no contact before this step, as computed in step CLEAR_CHECKED;
# SINCE_CONTACT: steps of Chipmunk since the last contact; COASTED: the positions of bodies are not
# yet in Chipmunk.
CLEAR_UNTIL, CLEAR_CHECKED, SINCE_CONTACT, COASTED = range(24, 28)
# DISCOVERIES: of the last look for garbage; CROWDED: a body touches two others; NEXT_GARBAGE_LOOK,
# NEXT_HUMANOID_LOOK: steps of the next looks.
DISCOVERIES, GARBAGE_IN_SIGHT, CROWDED = range(28, 31)
STEP, TURN, NEXT_GARBAGE_LOOK, NEXT_HUMANOID_LOOK, DRIVING, PATROLLING = range(31, 37)
INTS = 37
BEFORE_MOVING: Final = -1  # NEXT_GARBAGE_LOOK of a robot on a new leg

# Floats: STRIDE and HUMANOID_STRIDE are metres in a step.
HEADING_X, HEADING_Y, DT, PERCEPTION, SIGHT_SQUARED, STRIDE, HUMANOID_STRIDE = range(7)
CELL_WIDTH, SIDE, ROBOT_RADIUS, HUMANOID_RADIUS = range(7, 11)
FLOATS = 11

BEFORE: Final = Struct("6q2d")  # STEP to HEADING_Y
BEFORE_AT: Final = 8 * STEP  # bytes
AFTER: Final = Struct("7q")  # DISCOVERIES to NEXT_HUMANOID_LOOK
AFTER_AT: Final = 8 * DISCOVERIES  # bytes
