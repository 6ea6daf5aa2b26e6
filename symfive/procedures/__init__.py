"""Ready-made measurement campaigns without readings: nobody has to type poses.

Every procedure is a function of a machine (and options with sensible defaults) that returns runs;
`campaign_of` joins runs to a plan. A new procedure is one small file and its line here.
"""

from symfive.procedures._cone_circle import cone_circle
from symfive.procedures._limits import checked, followed, within_travel
from symfive.procedures._linear_positioning import linear_positioning
from symfive.procedures._nominal import Nominal
from symfive.procedures._path import DIRECTIONS, DWELL_S, ramp_of, senses, through
from symfive.procedures._planar_circle import FEED_IN_MM, PLANES, feed_in, planar_circle
from symfive.procedures._r_test_grid import r_test_grid
from symfive.procedures._rotary_circle import rotary_circle
from symfive.procedures._setting import (
    PAUSE_S,
    campaign_of,
    heights,
    left_in_place,
    one_after_another,
    serpentine,
    tool_ball_of,
)
from symfive.procedures._static_ball_bar import static_ball_bar
from symfive.procedures._synchronous_circle import (
    CircleFrame,
    circle_frame,
    frame_within_travel,
    polar_angle,
    synchronous_circle,
)

__all__ = [
    "DIRECTIONS", "DWELL_S", "FEED_IN_MM", "PAUSE_S", "PLANES", "CircleFrame", "Nominal", "campaign_of", "checked",
    "circle_frame", "cone_circle", "feed_in", "followed", "frame_within_travel", "heights", "left_in_place",
    "linear_positioning", "one_after_another", "planar_circle", "polar_angle", "r_test_grid", "ramp_of", "rotary_circle",
    "senses", "serpentine", "static_ball_bar", "synchronous_circle", "through", "tool_ball_of", "within_travel",
]  # fmt: skip
