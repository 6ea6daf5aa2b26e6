"""The digital calibration certificate: its schema, its numbers, what it leaves open, and that it says it is unsigned."""

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from history_world import Past
from pages import HOSTILE

from symfive import cli
from symfive.errors import InputError
from symfive.history import Office, Visit, certificate

DATA = Path(__file__).parent / "data"
NS = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
FULL = Office(laboratory="Lab & Co", laboratory_city="Aachen", person="E. Meyer", customer="Shop <1>", customer_city="Ulm",
              country="DE", number="K-17", manufacturer="Maker")  # fmt: skip


@pytest.fixture(scope="module")
def visit() -> Visit:
    drawn = Past(1, visits=1).drawn()[0]
    return replace(
        drawn, instrument="R-test 7", version="0.1.0", stage="as-left", machine=replace(drawn.machine, serial="A17")
    )


PROFILE, OFFICIAL = DATA / "dcc_profile.xsd", os.environ.get("SYMFIVE_DCC_XSD")
needs_official = pytest.mark.skipif(
    not OFFICIAL, reason="Skipped (optional): SYMFIVE_DCC_XSD does not name PTB's dcc.xsd 3.3.0."
)
SCHEMAS = [
    pytest.param(PROFILE, id="profile"),
    pytest.param(Path(OFFICIAL or "dcc.xsd"), marks=needs_official, id="official"),
]


@pytest.mark.parametrize("schema", SCHEMAS)
@pytest.mark.parametrize("office", [FULL, Office()], ids=["full", "empty"])
def test_the_certificate_is_valid(visit, schema, office):
    xmlschema = pytest.importorskip("xmlschema", reason="Skipped (optional): xmlschema is not installed.")
    checker = xmlschema.XMLSchema(str(schema))
    for one in (
        visit,
        replace(visit, temperature=None, stage="", instrument="", machine=replace(visit.machine, serial="")),
    ):
        checker.validate(ET.ElementTree(ET.fromstring(certificate(one, office))))


def test_the_certificate_says_what_its_uncertainty_leaves_out(visit):
    said = " ".join(element.text or "" for element in ET.fromstring(certificate(visit, FULL)).iter())
    assert "Calibration of the instrument, drift and remounting are not included" in said


WRONG = [
    ("<dcc:countryCodeISO3166_1>DE", "<dcc:countryCodeISO3166_1>Germany"),
    ('schemaVersion="3.3.0"', 'schemaVersion="2.0"'),
    ("si:coverageFactor", "si:factor"),
    ("<si:coverageFactor>2<", "<si:coverageFactor>0.5<"),
    ("<si:coverageProbability>0.9545<", "<si:coverageProbability>95.45<"),
    ("<si:coverageProbability>0.9545<", "<si:coverageProbability>.9545<"),
    ("<si:valueExpandedMU>", "<si:valueExpandedMU>-"),
    ("<dcc:uniqueIdentifier>", "<dcc:uniqueIdentifier> "),
]


@pytest.mark.parametrize("schema", SCHEMAS)
def test_what_breaks_the_schema_is_refused(visit, schema):
    xmlschema = pytest.importorskip("xmlschema", reason="Skipped (optional): xmlschema is not installed.")
    checker = xmlschema.XMLSchema(str(schema))
    text = certificate(visit, FULL).decode()
    for good, bad in WRONG:
        assert good in text
        assert not checker.is_valid(ET.ElementTree(ET.fromstring(text.replace(good, bad)))), bad


def test_the_profile_refuses_a_unit_that_is_no_d_si(visit):
    """The schema takes any text as a unit."""
    xmlschema = pytest.importorskip("xmlschema", reason="Skipped (optional): xmlschema is not installed.")
    text = certificate(visit, FULL).decode().replace("\\micro\\metre", "um")
    assert not xmlschema.XMLSchema(str(PROFILE)).is_valid(ET.ElementTree(ET.fromstring(text)))


def mutants(root: ET.Element) -> Iterator[ET.Element]:
    """The certificate with one element left out, renamed, behind its neighbour or without its text."""
    for k in range(sum(len(parent) for parent in root.iter())):
        for change in ("drop", "rename", "swap", "empty"):
            copy = deepcopy(root)
            parent, i = [(parent, i) for parent in copy.iter() for i in range(len(parent))][k]
            child = parent[i]
            if change == "rename":
                child.tag += "X"
            elif change == "empty":
                child.text = " "
            else:
                parent.remove(child)
            if change == "swap":
                parent.insert(i + 1, child)
            yield copy


@needs_official
def test_the_profile_accepts_nothing_that_the_schema_refuses(visit):
    xmlschema = pytest.importorskip("xmlschema", reason="Skipped (optional): xmlschema is not installed.")
    profile, official = xmlschema.XMLSchema(str(PROFILE)), xmlschema.XMLSchema(OFFICIAL)
    refused = [one for one in mutants(ET.fromstring(certificate(visit, FULL))) if not official.is_valid(one)]
    assert refused
    assert not any(profile.is_valid(one) for one in refused)


def test_the_rules_of_good_practice_accept_a_complete_certificate(visit):
    """PTB's Schematron; of one that is not filled in it refuses the country."""
    schematron = pytest.importorskip(
        "dcclib.validation.schematron", reason="Skipped (optional): dcclib is not installed."
    )
    rules = schematron.SchematronValidator.for_dcc()
    assert rules.validate_str(certificate(visit, FULL).decode()).is_valid
    refused = rules.validate_str(certificate(visit, Office()).decode())
    assert [report.location.split("}")[-1] for report in refused.failed_assertions] == ["countryCodeISO3166_1[1]"]


def test_every_number_is_that_of_the_visit_with_k_2(visit):
    root = ET.fromstring(certificate(visit, FULL))
    found = {}
    for real in root.findall(".//dcc:result//si:real", NS):
        label, value, unit = (real.findtext(f"si:{tag}", namespaces=NS) for tag in ("label", "value", "unit"))
        expanded = real.findtext(".//si:valueExpandedMU", namespaces=NS)
        assert real.findtext(".//si:coverageFactor", namespaces=NS) == "2"
        assert real.findtext(".//si:coverageProbability", namespaces=NS) == "0.9545"
        found[label] = float(value), float(expanded), unit
        assert len(expanded.replace(".", "").strip("0")) <= 2, "JCGM 100:2008, 7.2.6: at most two significant digits"
        assert len(value.partition(".")[2]) == len(expanded.partition(".")[2])
    assert set(found) == set(visit.names)
    for i, name in enumerate(visit.names):
        unit = r"\micro\metre" if visit.units[i] == "um" else r"\micro\radian"
        u = 2 * visit.std[i]
        assert found[name] == (pytest.approx(visit.values[i], abs=0.05 * u), pytest.approx(u, rel=0.05), unit)
    assert root.findtext(".//dcc:status", namespaces=NS) == "afterAdjustment"


def test_what_is_not_determined_has_no_value_and_is_named(visit):
    open_ = replace(visit, covariance=visit.covariance + np.diag([80.0**2, *[0.0] * 7]))
    text = certificate(open_, FULL).decode()
    root = ET.fromstring(text)
    assert "EX0B" not in [label.text for label in root.findall(".//si:label", NS)]
    assert "does not determine EX0B;" in text
    with pytest.raises(InputError, match="determine no error"):
        certificate(replace(visit, covariance=visit.covariance + np.eye(8) * 1e4), FULL)


def test_it_is_unsigned_and_says_what_is_missing(visit):
    text = certificate(visit, Office()).decode()
    assert "This certificate is unsigned" in text and "TO BE FILLED IN" in text
    assert text.count("<dcc:cryptElectronicSignature>false") == 1
    assert "laboratory, laboratory city, person, customer, customer city, country" in text
    assert "TO BE FILLED IN" not in certificate(visit, FULL).decode()


def test_text_of_users_is_escaped(visit):
    hostile = replace(FULL, customer=HOSTILE, person=HOSTILE)
    root = ET.fromstring(certificate(replace(visit, machine=replace(visit.machine, name=HOSTILE)), hostile))
    assert HOSTILE in [c.text for c in root.iter("{https://ptb.de/dcc}content")]
    for wrong in ({"country": "Germany"}, {"place": "moon"}):
        with pytest.raises(InputError):
            Office(**wrong)


def test_the_command(tmp_path, capsys):
    from history_world import results

    folder = results(tmp_path / "r")
    words = ["history", "certificate", str(folder), "-o", str(tmp_path / "dcc.xml")]
    words += ["--date", "2026-03-04", "--country", "DE"]
    assert cli.main(words) == 0
    said = capsys.readouterr()
    assert "unsigned" in said.err and "--laboratory" in said.err
    assert "2026-03-04" in (tmp_path / "dcc.xml").read_text()
    assert cli.main(words) == 2 and "exists" in capsys.readouterr().err
