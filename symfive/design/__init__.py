"""The designer: measurement plans that tell most, with a certificate, ready to run."""

from symfive.design._assess import Assessment, assess
from symfive.design._certificate import Certificate
from symfive.design._criteria import CRITERIA, Criterion, criterion_of
from symfive.design._plan import Plan, plan

__all__ = ["CRITERIA", "Assessment", "Certificate", "Criterion", "Plan", "assess", "criterion_of", "plan"]
