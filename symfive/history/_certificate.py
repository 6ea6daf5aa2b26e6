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
from decimal import Decimal
from typing import Any

from symfive.errors import InputError
from symfive.files import one_line, shown
from symfive.history._visit import Visit
from symfive.parameters import DETERMINED
from symfive.version import __version__

DCC, SI, XSI = "https://ptb.de/dcc", "https://ptb.de/si", "http://www.w3.org/2001/XMLSchema-instance"
VERSION, LANGUAGE = "3.3.0", "en"
FACTOR, PROBABILITY = 2.0, 0.9545
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
        if self.place not in PLACES:
            raise InputError(f"place {shown(self.place)} is unknown", remedy=f"use one of {', '.join(PLACES)}")
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
    for prefix, space in (("dcc", DCC), ("si", SI), ("xsi", XSI)):
        ET.register_namespace(prefix, space)
    root = ET.Element(f"{{{DCC}}}digitalCalibrationCertificate", {
        "schemaVersion": VERSION, f"{{{XSI}}}schemaLocation": f"{DCC} {DCC}/v{VERSION}/dcc.xsd",
    })  # fmt: skip
    _administration(_add(root, "administrativeData"), visit, office)
    _measurement(_add(_add(root, "measurementResults"), "measurementResult"), visit, sure)
    ET.indent(root)
    return bytes(ET.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _administration(parent: ET.Element, visit: Visit, office: Office) -> None:
    _software(_add(parent, "dccSoftware"))
    core = _add(parent, "coreData")
    _add(core, "countryCodeISO3166_1", office.country or "ZZ")
    _add(core, "usedLangCodeISO639_1", LANGUAGE)
    _add(core, "mandatoryLangCodeISO639_1", LANGUAGE)
    _add(core, "uniqueIdentifier", office.number or f"symfive-{visit.results[:32]}")
    _add(core, "beginPerformanceDate", visit.date)
    _add(core, "endPerformanceDate", visit.date)
    _add(core, "performanceLocation", office.place)
    item = _add(_add(parent, "items"), "item")
    _text(item, "name", f"Machine tool {visit.machine.name}, structure {visit.machine.structure} (ISO 10791-6)")
    if office.manufacturer:
        _text(_add(item, "manufacturer"), "name", office.manufacturer)
    identifications = _add(item, "identifications")
    if visit.machine.serial:
        _identification(identifications, "manufacturer", visit.machine.serial, "Serial number")
    _identification(identifications, "other", visit.results, "SHA-256 of the results")
    laboratory = _add(parent, "calibrationLaboratory")
    _contact(laboratory, "contact", office.laboratory, office.laboratory_city, office.country)
    for kind in ("Seal", "Signature", "TimeStamp"):
        _add(laboratory, f"cryptElectronic{kind}", "false")
    person = _add(_add(parent, "respPersons"), "respPerson")
    _text(_add(person, "person"), "name", office.person or TO_FILL)
    _add(person, "mainSigner", "true")
    _contact(parent, "customer", office.customer, office.customer_city, office.country)
    _statements(_add(parent, "statements"), visit, office)


def _statements(parent: ET.Element, visit: Visit, office: Office) -> None:
    unsigned = "This certificate is unsigned: it bears no electronic signature, seal or time stamp. It is valid only after the "
    unsigned += "responsible person has checked, completed and signed it."
    said = {"Unsigned": unsigned}
    if office.open:
        said["To be filled in"] = ", ".join(name.replace("_", " ") for name in office.open)
    unsure = [n for i, n in enumerate(visit.names) if visit.std[i] >= DETERMINED * visit.priors[i]]
    if unsure:
        said["Not determined"] = f"The measurement does not determine {', '.join(unsure)}; they have no value here."
    said["Uncertainty"] = (
        "Expanded uncertainties are twice the standard uncertainty (k = 2) of a normal distribution. The values are "
    )
    said["Uncertainty"] += "correlated; their covariance is in the model whose hash is given."
    said["Convention"] = "Errors by ISO 230-1, deviations from the nominal machine of the model."
    for name, text in said.items():
        statement = _add(parent, "statement")
        _text(statement, "name", name)
        _text(statement, "declaration", text)


def _measurement(parent: ET.Element, visit: Visit, sure: list[int]) -> None:
    _text(parent, "name", "Location errors and error motions of the axes")
    method = _add(_add(parent, "usedMethods"), "usedMethod")
    _text(method, "name", "Least-squares identification of the kinematic model from readings at the tool")
    _add(method, "norm", "ISO 230-1:2012")
    _software(_add(parent, "usedSoftware"), visit.version)
    if visit.instrument:
        equipment = _add(_add(parent, "measuringEquipments"), "measuringEquipment")
        _text(equipment, "name", visit.instrument)
    condition = _add(_add(parent, "influenceConditions"), "influenceCondition")
    _text(condition, "name", "Temperature of the machine")
    if visit.stage in STATUS:
        _add(condition, "status", STATUS[visit.stage])
    quantity = _add(_add(condition, "data"), "quantity")
    if visit.temperature is None:
        _text(quantity, "noQuantity", "not recorded")
    else:
        real = _add(quantity, "real", space=SI)
        _add(real, "value", _decimal(visit.temperature), space=SI)
        _add(real, "unit", r"\degreecelsius", space=SI)
    results = _add(parent, "results")
    for i in sure:
        result = _add(results, "result")
        name = visit.names[i]
        _text(
            result,
            "name",
            f"{name}: {KINDS.get(name[1:2], 'Error')} of axis {name.removeprefix(name[:2]).removeprefix('0')}",
        )
        real = _add(_add(_add(result, "data"), "quantity"), "real", space=SI)
        _add(real, "label", name, space=SI)
        _add(real, "value", _decimal(visit.values[i]), space=SI)
        _add(real, "unit", UNITS[visit.units[i]], space=SI)
        expanded = _add(_add(real, "measurementUncertaintyUnivariate", space=SI), "expandedMU", space=SI)
        _add(expanded, "valueExpandedMU", _decimal(FACTOR * visit.std[i]), space=SI)
        _add(expanded, "coverageFactor", _decimal(FACTOR), space=SI)
        _add(expanded, "coverageProbability", _decimal(PROBABILITY), space=SI)
        _add(expanded, "distribution", "normal", space=SI)


def _software(parent: ET.Element, version: str = "") -> None:
    software = _add(parent, "software")
    _text(software, "name", "symfive")
    _add(software, "release", f"v{version or __version__}")
    _add(software, "type", "application")


def _identification(parent: ET.Element, issuer: str, value: str, name: str) -> None:
    identification = _add(parent, "identification")
    _add(identification, "issuer", issuer)
    _add(identification, "value", value)
    _text(identification, "name", name)


def _contact(parent: ET.Element, tag: str, name: str, city: str, country: str) -> None:
    contact = _add(parent, tag)
    _text(contact, "name", name or TO_FILL)
    location = _add(contact, "location")
    _add(location, "city", city or TO_FILL)
    if country:
        _add(location, "countryCode", country)


def _text(parent: ET.Element, tag: str, text: str) -> None:
    """Text in the one language of the certificate."""
    _add(_add(parent, tag), "content", text).set("lang", LANGUAGE)


def _add(parent: ET.Element, tag: str, text: str = "", *, space: str = DCC) -> ET.Element:
    element = ET.SubElement(parent, f"{{{space}}}{tag}")
    if text:
        element.text = text
    return element


def _decimal(value: Any) -> str:
    """The number with six significant digits, without an exponent, as D-SI writes decimals."""
    return f"{Decimal(f'{float(value):.6g}'):f}"
