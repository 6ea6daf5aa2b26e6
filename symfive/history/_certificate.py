"""A digital calibration certificate (PTB's DCC 3.3.0, numbers as D-SI 2.2) of one visit, unsigned.

The certificate holds what the visit determined: each error with its expanded uncertainty, k = 2. What a laboratory must say
and no result tells stands as `TO_FILL` until it is given. It is no certificate of an accredited laboratory before that
laboratory has checked, completed and signed it; the file says so.
Source: https://ptb.de/dcc/v3.3.0/dcc.xsd, D. Hutzschenreuter et al. 2019, SmartCom Digital System of Units (D-SI).
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, fields

from symfive.drawing import templates
from symfive.errors import InputError, among
from symfive.files import one_line, shown
from symfive.history._visit import Visit
from symfive.numbers import decimals
from symfive.parameters import DETERMINED
from symfive.version import __version__

SPACES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si", "xsi": "http://www.w3.org/2001/XMLSchema-instance"}
FACTOR = 2.0
MOST_PLACES = 6
"""Decimals of a value without uncertainty."""
TO_FILL = "TO BE FILLED IN"
UNITS = {"um": r"\micro\metre", "urad": r"\micro\radian"}
PLACES = ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
KINDS = {"X": "Displacement along X", "Y": "Displacement along Y", "Z": "Displacement along Z", "A": "Rotation about X",
         "B": "Rotation about Y", "C": "Rotation about Z"}  # fmt: skip
STATUS = {"as-found": "beforeAdjustment", "as-left": "afterAdjustment"}


@dataclass(frozen=True, kw_only=True)
class Office:
    """Who certifies what for whom; what is empty is marked in the certificate as to be filled in.

    `country` two letters (ISO 3166-1), `place` one of `PLACES`: where the measurement was made.
    """

    laboratory: str = ""
    laboratory_city: str = ""
    person: str = ""
    customer: str = ""
    customer_city: str = ""
    country: str = ""
    number: str = ""
    manufacturer: str = ""
    place: str = "customer"

    def __post_init__(self) -> None:
        among(self.place, PLACES, f"place {shown(self.place)} is unknown")
        if self.country and not re.fullmatch("[A-Z]{2}", self.country):
            problem = f"country {shown(self.country)} is not two capital letters"
            raise InputError(problem, remedy="write a code of ISO 3166-1, as DE")
        for entry in fields(self):
            object.__setattr__(self, entry.name, one_line(getattr(self, entry.name)))

    @property
    def open(self) -> tuple[str, ...]:
        """What is still to be filled in."""
        needed = ("laboratory", "laboratory_city", "person", "customer", "customer_city", "country")
        return tuple(name for name in needed if not getattr(self, name))


def certificate(visit: Visit, office: Office) -> bytes:
    """The certificate as XML. Raises `InputError` where the visit determined no error in µm or µrad."""
    sure = [i for i, name in enumerate(visit.names)
            if visit.units[i] in UNITS and visit.std[i] < DETERMINED * visit.priors[i] and "." not in name]  # fmt: skip
    if not sure:
        problem = "the results determine no error of the machine"
        raise InputError(problem, remedy="use another test; symfive assess shows what a test determines")
    errors = [
        {"name": visit.names[i], "title": _title(visit.names[i]), "unit": UNITS[visit.units[i]],
         **_stated(visit.values[i], FACTOR * visit.std[i])}
        for i in sure
    ]  # fmt: skip
    filled = templates("symfive.history", "pages").get_template("certificate.xml").render(
        visit=visit, office=office, statements=_statements(visit, office), errors=errors, status=STATUS.get(visit.stage, ""),
        temperature=f"{visit.temperature or 0.0:.3f}".rstrip("0").rstrip("."), own_version=__version__, to_fill=TO_FILL,
    )  # fmt: skip
    for prefix, space in SPACES.items():
        ET.register_namespace(prefix, space)
    root = ET.fromstring(filled)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _statements(visit: Visit, office: Office) -> dict[str, str]:
    """What the certificate says of itself, by its headings."""
    said = {
        "Unsigned": "This certificate is unsigned: it bears no electronic signature, seal or time stamp. It is valid only after "
        "the responsible person has checked, completed and signed it."
    }
    if office.open:
        said["To be filled in"] = ", ".join(name.replace("_", " ") for name in office.open)
    unsure = [n for i, n in enumerate(visit.names) if visit.std[i] >= DETERMINED * visit.priors[i]]
    if unsure:
        said["Not determined"] = f"The measurement does not determine {', '.join(unsure)}; they have no value here."
    said["Uncertainty"] = (
        "Expanded uncertainties are twice the standard uncertainty (k = 2) of a normal distribution. They are those of the fit: "
        "noise of the readings, the priors, and the standard uncertainties that the campaign states for the set-up (position of "
        "balls or sphere, length of the bar). Calibration of the instrument, drift and remounting are not included. The values "
        "are correlated; their covariance is in the model whose hash is given."
    )
    said["Convention"] = "Errors by ISO 230-1, deviations from the nominal machine of the model."
    return said


def _title(name: str) -> str:
    """An error in words, as `EA0C: Rotation about X of axis C`."""
    return f"{name}: {KINDS.get(name[1:2], 'Error')} of axis {name.removeprefix(name[:2]).removeprefix('0')}"


def _stated(value: float, expanded: float) -> dict[str, str]:
    """Both without an exponent, as D-SI writes decimals: U with two significant digits, the value to the same place (JCGM
    100:2008, 7.2.6)."""
    places = decimals(expanded) if expanded > 0.0 else MOST_PLACES
    numbers = {"value": value, "expanded": expanded}
    return {key: f"{round(float(number), places) + 0.0:.{max(places, 0)}f}" for key, number in numbers.items()}
