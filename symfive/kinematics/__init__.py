"""The exact kinematic chain and the function bases of its error motions, symbolic in CasADi; serial chains in numbers."""

from symfive.kinematics._bases import Basis, basis_of, function_words
from symfive.kinematics._chain import (
    Chain,
    Pose,
    angles,
    axis_pose,
    ball_in_workpiece,
    chain_of,
    chain_poses,
    first_order,
)
from symfive.kinematics._serial import axes_of_modified_dh, forward, placement, rounded

__all__ = [
    "Basis", "Chain", "Pose", "angles", "axes_of_modified_dh", "axis_pose", "ball_in_workpiece", "basis_of", "chain_of",
    "chain_poses", "first_order", "forward", "function_words", "placement", "rounded",
]  # fmt: skip
