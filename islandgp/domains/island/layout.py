"""Indices of the two arrays by which Python and compiled code share an episode's state."""

from __future__ import annotations

# Whole numbers: the state of the loop. FOUND: garbage is in sight; NEW: items that the last look
# discovered.
STEP, TURN, GROUND_DUE, PEOPLE_DUE, FOUND, NEW, DRIVING, PATROLLING = range(8)
BEFORE_MOVING = -1  # GROUND_DUE of a robot on a new leg
# CROWDED: a body touches two others; CLEAR: no contact before this step, as of the step CHECKED;
# QUIET: steps of Chipmunk since the last contact; FLOWN: bodies are not where Chipmunk has them.
CROWDED, CLEAR, CHECKED, QUIET, FLOWN = range(8, 13)
# Settings. FLIES: steps may be left out.
PEOPLE, COLUMNS, ASK_FROM, MOST_ITEMS, FLIES, ROCKS = range(13, 19)
# Addresses of Chipmunk's objects, and of arrays. BODIES: the robot and the humanoids; MOTION: x, y,
# vx and vy of each; ROCK: x, y and radius of each.
SPACE, BODIES, MOTION, TOUCHING, TURN_STEP, TURN_WHO, TURN_VELOCITY = range(19, 26)
ITEMS, DUES, UNSEEN, NEAR, X, Y, THERE, SEEN, FIRST, MEMBERS, ROCK = range(26, 37)
WHOLE_NUMBERS = 37

# Numbers: the robot's heading, and settings.
HEADING_X, HEADING_Y, DT, PERCEPTION, SIGHT, STRIDE, WALK, CELL = range(8)
SIDE, ROBOT_RADIUS, HUMANOID_RADIUS = range(8, 11)
NUMBERS = 11
