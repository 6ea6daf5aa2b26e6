"""Code for controllers, derived from the model: C99 sources, LinuxCNC kinematics, compensation tables, sheets."""

from symfive.codegen._codegen import TARGETS, codegen
from symfive.codegen._subject import Subject, subject_of

__all__ = ["TARGETS", "Subject", "codegen", "subject_of"]
