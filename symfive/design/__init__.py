"""The designer: optimal measurement plans, with a certificate, ready to run."""

from symfive.design._assess import Assessment, assess
from symfive.design._assessment_data import assessment_data
from symfive.design._certificate import Certificate
from symfive.design._circular_test import CircularTest, circular_test
from symfive.design._criteria import CRITERIA, Criterion, criterion_of
from symfive.design._discriminate import (
    APART,
    PAUSE_S,
    Candidate,
    Discrimination,
    Separation,
    discriminate,
    in_addition,
    in_common,
)
from symfive.design._dynamic import Circle, CirclePlan, best_ratio, circle_information, plan_circles
from symfive.design._joint_certificate import JointCertificate, certify_joint
from symfive.design._paths import FAMILIES
from symfive.design._plan import Plan, plan
from symfive.design._sweep_certificate import SweepCertificate
from symfive.design._sweep_plan import SweepPlan, plan_sweeps
from symfive.design._together import JointPlan, plan_together
from symfive.design._until import plan_until
from symfive.design._write import write_test

__all__ = [
    "APART", "CRITERIA", "FAMILIES", "PAUSE_S", "Assessment", "Candidate", "Certificate", "Circle", "CirclePlan", "CircularTest",
    "Criterion", "Discrimination", "JointCertificate", "JointPlan", "Plan", "Separation", "SweepCertificate", "SweepPlan",
    "assess", "assessment_data", "best_ratio", "certify_joint", "circle_information", "circular_test", "criterion_of",
    "discriminate", "in_addition", "in_common", "plan", "plan_circles", "plan_sweeps", "plan_together", "plan_until",
    "write_test",
]  # fmt: skip
