"""Every page fits a telephone, a screen and a sheet of paper, in light and in dark."""

import html
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import symfive as sf
from symfive.machine import preset
from symfive.procedures import campaign_of, r_test_grid
from symfive.results import write_diagnosis, write_identification

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
NESTS = Path(__file__).parent / "data" / "campaigns" / "static-none" / "fit"
PAGES = ("setup.html", "identification.html", "report.html", "sf.html", "sf-siemens.html", "sf-haas.html", "fleet.html",
         "history.html")  # fmt: skip
MEASURE = """<script>addEventListener("load", () => {
  const root = document.documentElement, wide = root.clientWidth;
  const inside = e => { for (let p = e.parentElement; p; p = p.parentElement)
    if (["auto", "hidden", "scroll"].includes(getComputedStyle(p).overflowX)) return true; };
  const out = [...document.querySelectorAll("main *")].filter(e => !e.closest("svg") && !inside(e)
    && e.getBoundingClientRect().right > wide + 1);
  const cut = [...document.querySelectorAll("main *")].filter(e => e.scrollHeight > e.clientHeight + 2
    && ["auto", "hidden", "scroll"].includes(getComputedStyle(e).overflowY) && getComputedStyle(e).maxHeight !== "none");
  top.document.title = `wide ${wide} needs ${root.scrollWidth} out ${out.length} cut ${cut.length} `
    + `paper ${getComputedStyle(document.body).backgroundColor}`; });</script></body>"""

FRAME = """<!doctype html><iframe style="width: {width}px; height: 900px; border: 0" srcdoc="{page}"></iframe>"""
"""A window may be no narrower than 500 px, a frame may."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    """One page of each kind."""
    folder = tmp_path_factory.mktemp("pages")
    plan = sf.plan("table-bc", points=12, starts=1, anywhere=False)
    plan.write(folder / "plan")
    for name in ("id", "diagnosis"):
        (folder / name).mkdir()
    result = sf.identify(sf.simulate(plan))
    write_identification(result, folder / "id")
    for target in ("c", "siemens", "haas"):
        sf.codegen(sf.fitted_model(result), folder / "code" / target, target=target)
    write_diagnosis(sf.diagnose(NESTS), folder / "diagnosis")
    found = {path.name: path for path in folder.rglob("*.html")}
    with sf.History(folder / "history", create=True) as history:
        history.add(folder / "id")
        fleet, machine = history.write_pages(folder / "pages")
    return {**found, "fleet.html": fleet, "history.html": machine}


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="Skipped (optional): no Chromium on this computer.")
@pytest.mark.parametrize("name", PAGES)
def test_no_page_is_wider_than_its_window_nor_cuts_a_table(pages, tmp_path, name):
    text = re.sub(r"<meta http-equiv[^>]*>", "", pages[name].read_text()).replace("</body>", MEASURE)
    papers = set()
    for width, dark in ((400, 0), (400, 1), (1280, 0)):
        (tmp_path / "page.html").write_text(FRAME.format(width=width, page=html.escape(text)))
        said = subprocess.run(
            [CHROMIUM, "--no-sandbox", "--headless", "--disable-gpu", "--no-first-run", "--dump-dom",
             "--disable-background-networking", f"--user-data-dir={tmp_path / 'user'}", "--window-size=1400,1000",
             f"--blink-settings=preferredColorScheme={1 - dark}", f"file://{tmp_path / 'page.html'}"],
            capture_output=True, text=True, timeout=120, check=True,
        ).stdout  # fmt: skip
        wide, needs, out, cut, paper = re.search(
            r"<title>wide (\d+) needs (\d+) out (\d+) cut (\d+) paper (.*?)</title>", said
        ).groups()
        assert int(needs) <= int(wide) and out == "0" and cut == "0", (width, wide, needs, out, cut)
        papers.add((dark, paper))
    assert len({paper for _, paper in papers}) == 2, papers


HEADS = """<script>addEventListener("load", () => {
  const text = e => { const range = document.createRange(); range.selectNodeContents(e); return range.getBoundingClientRect(); };
  const gaps = [...document.querySelectorAll("thead tr")].flatMap(row => [...row.cells].slice(1).map((cell, i) =>
    text(cell).width ? text(cell).left - text(row.cells[i]).right : 99));
  top.document.title = `gap ${Math.min(99, ...gaps).toFixed(1)} wide ${document.documentElement.clientWidth} `
    + `needs ${document.documentElement.scrollWidth}`; });</script></body>"""
A4_PX = 688
"""An A4 page without its margins of 14 mm, 96 px an inch."""


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="Skipped (optional): no Chromium on this computer.")
@pytest.mark.parametrize("name", PAGES)
def test_heads_of_tables_stand_apart_on_paper_and_pages_fit_it(pages, tmp_path, name):
    text = re.sub(r"<meta http-equiv[^>]*>", "", pages[name].read_text()).replace("</body>", HEADS)
    text = text.replace("@media print", "@media all")
    (tmp_path / "page.html").write_text(FRAME.format(width=A4_PX, page=html.escape(text)))
    said = subprocess.run(
        [CHROMIUM, "--no-sandbox", "--headless", "--disable-gpu", "--no-first-run", "--dump-dom",
         "--disable-background-networking", f"--user-data-dir={tmp_path / 'user'}", "--window-size=1400,1000",
         f"file://{tmp_path / 'page.html'}"],
        capture_output=True, text=True, timeout=120, check=True,
    ).stdout  # fmt: skip
    gap, wide, needs = re.search(r"<title>gap (\S+) wide (\d+) needs (\d+)</title>", said).groups()
    assert float(gap) >= 4.0 and int(needs) <= int(wide), (gap, wide, needs)


def test_every_page_has_the_one_style(tmp_path):
    """Quick and without a browser: each kind of page is written with the shared style and for a telephone."""
    from symfive.codegen import codegen
    from symfive.design import Sheet, setup_sheet
    from symfive.drawing import PAGE_STYLE
    from symfive.nc import Post

    assert "prefers-color-scheme: dark" in PAGE_STYLE and "@media print" in PAGE_STYLE and "size: A4" in PAGE_STYLE
    machine = preset("oyama-2010")
    campaign = campaign_of(machine, r_test_grid(machine, step_deg=90.0))
    page = setup_sheet(Sheet(campaign=campaign, post=Post()), {}, [])
    (sheet,) = codegen("table-bc", tmp_path, target="siemens")
    for text in (page, sheet.read_text(encoding="utf-8")):
        assert PAGE_STYLE in text and '<meta name="viewport"' in text and "<main>" in text
