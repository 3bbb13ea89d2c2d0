"""Indices of the two arrays by which Python and compiled code share an episode's state.

`ints` has whole numbers: the state of the loop, settings, and addresses of Chipmunk's objects and
of arrays. `floats` has the robot's heading and settings.
"""

from __future__ import annotations

# State of the loop. NEXT_GARBAGE_LOOK, NEXT_HUMANOID_LOOK: steps of the next looks; DISCOVERIES: of
# the last look for garbage.
STEP, TURN, NEXT_GARBAGE_LOOK, NEXT_HUMANOID_LOOK = range(4)
GARBAGE_IN_SIGHT, DISCOVERIES, DRIVING, PATROLLING = range(4, 8)
BEFORE_MOVING = -1  # NEXT_GARBAGE_LOOK of a robot on a new leg
# CROWDED: a body touches two others; CLEAR_UNTIL: no contact before this step, as computed in step
# CLEAR_CHECKED; SINCE_CONTACT: steps of Chipmunk since the last contact; COASTED: the positions of
# bodies are not yet in Chipmunk.
CROWDED, CLEAR_UNTIL, CLEAR_CHECKED, SINCE_CONTACT, COASTED = range(8, 13)
# Settings. MAY_COAST: see kernel.py.
HUMANOIDS, COLUMNS, ASK_FROM, MAX_ITEMS, MAY_COAST, ROCK_COUNT = range(13, 19)
# Addresses. BODIES: the robot and the humanoids; MOTION: x, y, vx and vy of each. CARRIED to
# ASKING_NEAR have a value for each humanoid, ITEM_X to DISCOVERED one for each item of garbage.
SPACE, BODIES, MOTION, TOUCHING, TURN_STEPS, TURN_HUMANOIDS, TURN_VELOCITIES = range(19, 26)
CARRIED, LOOK_STEPS, UNSEEN, ASKING_NEAR = range(26, 30)
ITEM_X, ITEM_Y, PRESENT, DISCOVERED = range(30, 34)
# CELL_ITEMS: items in and around cell c are those from CELL_STARTS[c] to CELL_STARTS[c + 1].
CELL_STARTS, CELL_ITEMS = range(34, 36)
ROCKS = 36  # x, y and radius of each
INTS = 37

# Floats: STRIDE and HUMANOID_STRIDE are metres in a step.
HEADING_X, HEADING_Y, DT, PERCEPTION, SIGHT_SQUARED, STRIDE, HUMANOID_STRIDE = range(7)
CELL_WIDTH, SIDE, ROBOT_RADIUS, HUMANOID_RADIUS = range(7, 11)
FLOATS = 11
