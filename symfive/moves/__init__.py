"""Moves between the poses of a run: the bodies that may not meet, paths clear of them, order and time.

post = cleared(machine, campaign.runs, {})                               # paths of the programs, all of them clear
blocked_moves(machine, run, program_steps(machine, run, post))           # [] : every move sampled again
"""

from symfive.moves._bodies import (
    BALL_RADIUS,
    NOSE_LENGTH,
    RAPID_MM,
    SMOOTH,
    angle_clearance,
    least_elevation,
    least_upright,
    nose_may_reach_post,
    nose_over_table,
    off_obstacles,
    out_of_nest_clearance,
    post_clearance,
)
from symfive.moves._clearances import Clearances
from symfive.moves._distance import Box, Rod, apart
from symfive.moves._moves import Moves, blocked_moves
from symfive.moves._order import kept_apart, move_times, out_and_back, round_trip, there_and_back
from symfive.moves._ways import REMEDY, Tested, Ways, cleared, least_retract

__all__ = [
    "BALL_RADIUS", "NOSE_LENGTH", "RAPID_MM", "REMEDY", "SMOOTH", "Box", "Clearances", "Moves", "Rod", "Tested", "Ways",
    "angle_clearance", "apart", "blocked_moves", "cleared", "kept_apart", "least_elevation", "least_retract", "least_upright",
    "move_times", "nose_may_reach_post", "nose_over_table", "off_obstacles", "out_and_back", "out_of_nest_clearance",
    "post_clearance", "round_trip", "there_and_back",
]  # fmt: skip
