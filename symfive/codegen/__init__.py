"""Code for controllers, derived from the model: C99 sources, LinuxCNC kinematics, compensation tables, sheets."""

from symfive.codegen._codegen import TARGETS, codegen
from symfive.codegen.isg import read_isg

__all__ = ["TARGETS", "codegen", "read_isg"]
