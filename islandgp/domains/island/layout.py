"""Indices of the two arrays by which Python and compiled code share an episode's state."""

from __future__ import annotations

# Whole numbers: the state of the loop. FOUND: garbage is in sight; NEW: items that the last look
# discovered.
STEP, TURN, GROUND_DUE, PEOPLE_DUE, FOUND, NEW, DRIVING = range(7)
BEFORE_MOVING = -1  # GROUND_DUE of a robot on a new leg
# CROWDED: a body touches two others; CLEAR: no contact before this step, as of the step CHECKED;
# QUIET: steps of Chipmunk since the last contact.
CROWDED, CLEAR, CHECKED, QUIET = range(7, 11)
# Settings. FLIES: steps may be left out.
PEOPLE, COLUMNS, ASK_FROM, MOST_ITEMS, FLIES, ROCKS = range(11, 17)
# Addresses of Chipmunk's objects, and of arrays. ROCK: x, y and radius of each.
SPACE, ROBOT, BODIES, TOUCHING, TURN_STEP, TURN_WHO, TURN_VELOCITY = range(17, 24)
ITEMS, DUES, UNSEEN, NEAR, X, Y, THERE, SEEN, FIRST, MEMBERS, ROCK = range(24, 35)
PATROLLING = 35
WHOLE_NUMBERS = 36

# Numbers: the robot's heading and position, and settings.
HEADING_X, HEADING_Y, DT, PERCEPTION, SIGHT, STRIDE, WALK, CELL = range(8)
SIDE, ROBOT_RADIUS, HUMANOID_RADIUS, ROBOT_X, ROBOT_Y = range(8, 13)
NUMBERS = 13
