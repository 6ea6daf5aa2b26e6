"""Pages and server: self-contained, users' text escaped, every number there; only who has the token is answered."""

import http.client
import re
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from history_world import DAY, Past, results
from pages import HOSTILE, Page

from symfive.errors import InputError
from symfive.history import (
    Details,
    Event,
    Finding,
    History,
    MachineId,
    Server,
    Trend,
    fleet_page,
    machine_page,
    trend_of,
)


@pytest.fixture(scope="module")
def trend() -> Trend:
    """A machine with a step, a repair, findings, and hostile text wherever a user can write."""
    machine = MachineId(name=HOSTILE, serial=HOSTILE, structure="w C' B' X' Y' b Z t")
    found = Finding(effect="backlash", axis=HOSTILE, confidence=0.9, parameters={"width": (9.0, 0.3, "um")})
    visits = [
        replace(v, machine=machine, operator=HOSTILE, note=HOSTILE, instrument=HOSTILE, version="0.1.0", diagnosed=True,
                findings=(found,) if number > 60 else ())
        for number, v in enumerate(Past(2, visits=90, steps=[(80, "EX0C", 6.0)]).drawn())
    ]  # fmt: skip
    events = [Event(machine=machine, time=visits[40].time - DAY, kind="repair", text=HOSTILE)]
    return trend_of(visits, events, tolerances={"EX0C": 60.0})


def test_the_machine_page_is_whole_and_escaped(trend):
    text = machine_page(trend)
    page = Page(text)
    assert "script" not in page.tags[:-1] and page.tags.count("script") == 1 and "alert('x')" in page.words
    assert not [value for key, value in page.attributes if key in ("src", "href") and value]
    assert (
        "default-src 'none'" in text
        and "sha256-" in text
        and "http" not in re.sub(r"https?-equiv|http-equiv", "", text)
    )
    assert page.tags.count("figure") == len(trend.determined) == 8
    assert "step" in page.words and "EX0C" in page.words and "backlash" in page.words
    assert any("EX0C passes" in line or "EX0C stays within" in line for line in page.words.split("\n"))
    assert f"{len(trend.visits) - 60} earlier visits" in page.words


def test_every_drawn_number_is_a_number(trend):
    for attribute in re.findall(r' (?:d|x1|y1|x2|y2|x|y)="([^"]*)"', machine_page(trend)):
        assert not re.search("nan|inf", attribute)


def test_the_page_of_one_visit(trend):
    first = trend_of(list(trend.visits[:1]), [])
    assert "Errors over time" in Page(machine_page(first)).words


def test_the_fleet_page_lists_the_alarmed_first_and_links(tmp_path):
    with History(tmp_path / "history", create=True) as history:
        for number, name in enumerate(("alpha", "beta <b>")):
            history.add(results(tmp_path / f"r{number}", number, name=name), Details(time=1.7e9))
        files = history.write_pages(tmp_path / "pages")
        text = (tmp_path / "pages" / "fleet.html").read_text()
        links = [value for key, value in Page(text).attributes if key == "href"]
        assert {f.name for f in files} == {"fleet.html", *links} and len(links) == 2
        assert "beta <b>" in Page(text).words and "<b>" not in text
        table = history.fleet()
    state = {"alarms": [{"kind": "step", "when": "2026-01-05T00:00:00Z", "causes": []}], "spark": None, "events": []}
    rows = (table.rows[0], replace(table.rows[1], open=1, alarms=1, alarm=state["alarms"][0]))
    words = Page(fleet_page(replace(table, rows=rows), [state, state])).words
    assert words.index("beta") < words.index("alpha") and "1 machine with an open alarm" in words


# --- the server ---------------------------------------------------------------------------------------------------


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    with History(tmp_path / "history", create=True) as history:
        history.add(results(tmp_path / "r"), Details(time=1.7e9))
    found = Server(tmp_path / "history")
    thread = threading.Thread(target=found.serve)
    thread.start()
    yield found
    found.close()
    thread.join()


def ask(server: Server, path: str, method: str = "GET", **headers: str) -> tuple[int, dict[str, str], str]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, dict(answer.getheaders()), answer.read().decode()
    connection.close()
    return found


def test_who_has_the_token_sees_the_pages(server):
    status, headers, _ = ask(server, f"/?token={server.token}")
    assert status == 303 and headers["Location"] == "/" and "HttpOnly; SameSite=Strict" in headers["Set-Cookie"]
    cookie = headers["Set-Cookie"].partition(";")[0]
    status, headers, text = ask(server, "/", Cookie=cookie)
    assert status == 200 and "plant" in Page(text).words and headers["Cache-Control"] == "no-store"
    [link] = [value for key, value in Page(text).attributes if key == "href"]
    assert ask(server, f"/{link}", Cookie=cookie)[0] == 200
    assert ask(server, "/../history/index.sqlite", Cookie=cookie)[0] == 404
    assert ask(server, "/", "HEAD", Cookie=cookie)[2] == ""


def test_nobody_else_is_answered(server):
    assert ask(server, "/")[0] == 403
    assert ask(server, "/?token=guess")[0] == 403
    assert ask(server, "/", Cookie="symfive-history=guess")[0] == 403
    assert ask(server, f"/?token={server.token}", Host=f"evil.example:{server.port}")[0] == 421  # DNS rebinding
    assert ask(server, "/", "POST")[0] == 501
    assert not ask(server, f"//evil.example/?token={server.token}")[1].get("Location", "/").startswith("//")


def test_it_listens_on_the_loopback_alone_and_says_a_taken_port(server, tmp_path):
    assert server.address.startswith(f"http://127.0.0.1:{server.port}/?token=") and len(server.token) >= 32
    with pytest.raises(InputError, match="cannot be used"):
        Server(tmp_path / "history", server.port)
    with pytest.raises(InputError, match="there is no history"):
        Server(tmp_path / "nowhere")
