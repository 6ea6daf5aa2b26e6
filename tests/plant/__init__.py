"""Independent numpy plant: writes campaigns by FORMATS.md for testing symfive; shares no code with it."""

from .campaign import write_campaign, write_pair
from .chain import Chain, ball_in_workpiece, nominal_linear, parse_structure
from .drives import Drive, Friction, Motion, TwoMass, follow
from .effects import EFFECTS, OUTSIDE
from .machines import LOCATION, TOPOLOGIES, dynamic_table, machine, planar_table, static_table, topology
from .noise import LIKE_PLANAR, PLAIN, QUIET, NoiseOptions
from .paths import grid_poses, planar_circle, r_test, random_poses, static_ball_bar, synchronous_circle
from .simulate import Reading, simulate_run

__all__ = [
    "EFFECTS", "LIKE_PLANAR", "LOCATION", "OUTSIDE", "PLAIN", "QUIET", "TOPOLOGIES", "Chain", "Drive", "Friction", "Motion",
    "NoiseOptions", "Reading", "TwoMass", "ball_in_workpiece", "dynamic_table", "follow", "grid_poses", "machine",
    "nominal_linear", "parse_structure", "planar_circle", "planar_table", "r_test", "random_poses", "simulate_run",
    "static_ball_bar", "static_table", "synchronous_circle", "topology", "write_campaign", "write_pair",
]  # fmt: skip
