"""The designer: optimal measurement plans, with a certificate, ready to run.

`plan` does it all. Its steps are there too: `make_space` is what an instrument can read on a machine, `task_of` what is sought,
`optimise` finds a design, `certify` bounds how far it is from the best.
"""

from symfive.design._assess import Assessment, assess, assessment_data
from symfive.design._candidates import value_of
from symfive.design._certificate import Certificate, certify
from symfive.design._circles import Circle, circle_information
from symfive.design._circular_test import CircularTest, circular_test
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
from symfive.design._dynamic import CirclePlan, plan_circles
from symfive.design._information import Information, expected_information
from symfive.design._joint_certificate import JointCertificate, certify_joint
from symfive.design._optimise import optimise
from symfive.design._part import Part
from symfive.design._paths import FAMILIES, CircleShape
from symfive.design._plan import plan
from symfive.design._request import task_of
from symfive.design._result import Plan
from symfive.design._sheet import Sheet, setup_sheet
from symfive.design._space import Space, make_space
from symfive.design._sweep_plan import SweepPlan, plan_sweeps
from symfive.design._sweep_recordings import SweepCertificate
from symfive.design._together import JointPlan, plan_together
from symfive.design._until import plan_until
from symfive.design._write import write_test
from symfive.optimal import CRITERIA, Criterion, criterion_of

__all__ = [
    "APART", "CRITERIA", "FAMILIES", "PAUSE_S", "Assessment", "Candidate", "Certificate", "Circle", "CirclePlan", "CircleShape",
    "CircularTest", "Criterion", "Discrimination", "Information", "JointCertificate", "JointPlan", "Part", "Plan", "Separation",
    "Sheet", "Space", "SweepCertificate", "SweepPlan", "assess", "assessment_data", "certify", "certify_joint",
    "circle_information", "circular_test", "criterion_of", "discriminate", "expected_information", "in_addition", "in_common",
    "make_space", "optimise", "plan", "plan_circles", "plan_sweeps", "plan_together", "plan_until", "setup_sheet", "task_of",
    "value_of", "write_test",
]  # fmt: skip
