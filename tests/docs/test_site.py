"""The built site in a browser, after ``python -m sphinx docs docs/_build/html``."""

import json
import shutil
import threading
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

ROOT = Path(__file__).parents[2]
SITE, EXAMPLES = ROOT / "docs" / "_build" / "html", ROOT / "examples"
PAGES = sorted(
    p.relative_to(SITE).as_posix()
    for p in SITE.rglob("*.html")
    if "_static" not in p.parts
)
# Those of the reference are made by one template: a browser looks at some of them.
LOOKED_AT = [path for path in PAGES if "generated" not in path]
LOOKED_AT += [path for path in PAGES if "generated" in path][::8]
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = ["no-sandbox", "disable-gpu", "disable-quic", "disable-component-update"]
FLAGS += ["disable-background-networking", "disable-sync", "no-first-run"]
DESKTOP, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}

pytestmark = [
    pytest.mark.slow,  # the law of pages that stand alone; their build takes minutes
    pytest.mark.skipif(not PAGES, reason="the site is not built"),
]

FAULTS = """() => {
  // Hidden ones, such as a logo for the other scheme, may load later.
  const pictures = [...document.images].filter(i => i.offsetParent !== null);
  return {
    broken: pictures.filter(i => !(i.complete && i.naturalWidth)).map(i => i.src),
    textless: pictures.filter(i => !i.alt.trim()).map(i => i.src),
    overflow: Math.max(0, document.documentElement.scrollWidth - innerWidth),
  };
}"""


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def address():
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=SITE))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", exc_type=ImportError)
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine")
    with playwright.sync_playwright() as running:
        flags = [f"--{flag}" for flag in FLAGS]
        yield running.chromium.launch(executable_path=CHROMIUM, args=flags)


@pytest.fixture
def tab(browser, address):
    context = browser.new_context(viewport=DESKTOP)
    page = context.new_page()
    page.own, page.complaints = address, []
    page.route(
        lambda url: not url.startswith((address, "data:")), lambda route: route.abort()
    )

    def note(message):
        elsewhere = message.location.get("url", "")
        if message.type == "error" and not elsewhere.startswith("https:"):
            page.complaints.append(message.text)

    page.on("console", note)
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on(
        "response",
        lambda r: r.status >= 400 and page.complaints.append(f"{r.status} {r.url}"),
    )
    yield page
    context.close()


def faults_of(tab, path, *sizes):
    tab.goto(f"{tab.own}/{path}", wait_until="load")
    found = {}
    for size in sizes:
        tab.set_viewport_size(size)
        found |= {
            f"{size['width']} px: {what}": value
            for what, value in tab.evaluate(FAULTS).items()
            if value
        }
    if tab.complaints:
        found["console"] = list(tab.complaints)
        tab.complaints.clear()
    return found


@pytest.mark.parametrize("half", [0, 1])
def test_pages_have_no_fault_on_a_desk_or_a_phone(tab, half):
    faults = {path: faults_of(tab, path, DESKTOP, PHONE) for path in LOOKED_AT[half::2]}
    assert {path: page for path, page in faults.items() if page} == {}


def test_every_figure_is_a_picture():
    texts = {path: (SITE / path).read_text(encoding="utf-8") for path in PAGES}
    assert [path for path, text in texts.items() if "&lt;Figure size" in text] == []
    for path, text in texts.items():
        code = (EXAMPLES / path).with_suffix(".py")
        if code.exists() and ".plot_" in code.read_text("utf-8"):
            assert "data:image" in text or "_images/" in text, path


def test_every_page_of_code_offers_its_notebook():
    pages = [p for p in PAGES if (ROOT / "examples" / p).with_suffix(".py").exists()]
    assert pages
    for path in pages:
        name = Path(path).with_suffix(".ipynb")
        notebook = json.loads((SITE / "_sources" / name).read_text(encoding="utf-8"))
        code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        assert any(cell["outputs"] for cell in code) or "calculix" in path
        assert f"_sources/{name.as_posix()}" in (SITE / path).read_text("utf-8")


class Links(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.targets, self.names = set(), set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.names |= {given.get("id"), given.get("name")}
        if tag == "a" and given.get("href"):
            self.targets.add(given["href"])
        if tag == "img" and not str(given.get("src")).startswith("data:"):
            self.targets.add(given["src"])


def test_every_link_inside_leads_somewhere():
    read = {path: Links((SITE / path).read_text(encoding="utf-8")) for path in PAGES}
    lost = []
    for path, page in read.items():
        for target in page.targets:
            if "://" in target or target.startswith(("mailto:", "#")):
                continue
            file, anchor = map(unquote, urldefrag(target))
            other = (SITE / path).parent / file.partition("?")[0]
            name = other.resolve().relative_to(SITE.resolve()).as_posix()
            if not other.exists() or (
                anchor and name in read and anchor not in read[name].names
            ):
                lost.append((path, target))
    assert lost == []
