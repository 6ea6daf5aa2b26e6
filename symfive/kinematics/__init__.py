"""The exact kinematic chain and the function bases of its error motions, symbolic in CasADi."""

from symfive.kinematics._bases import Basis, basis_of
from symfive.kinematics._chain import Pose, angles, axis_pose, ball_in_workpiece, chain_poses, first_order

__all__ = ["Basis", "Pose", "angles", "axis_pose", "ball_in_workpiece", "basis_of", "chain_poses", "first_order"]
