"""The files of the page, and the page with all of them and its data in one file.

Knows the files in `web/`, and uPlot; nothing of drives.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from functools import cache
from importlib import resources
from typing import Any, Final, NamedTuple

from vve_sumo import uplot

#: kinds of the page's files, by their endings
KINDS: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}
#: files of uPlot, by the names that the page knows them by
LENT: Final = {"uplot.js": uplot.SCRIPT, "uplot.css": uplot.STYLE, "uplot.txt": uplot.LICENCE}
#: modules of the page in the order in which each finds what it needs before it
MODULES: Final = (
    "elements.js",
    "units.js",
    "canvas.js",
    "frames.js",
    "source.js",
    "street.js",
    "lot.js",
    "gauges.js",
    "strips.js",
    "seats.js",
    "drive.js",
    "live.js",
    "replay.js",
    "table.js",
    "main.js",
)
#: the street in three dimensions, which the page loads when somebody asks for it; built from `web/` of the repository
WORLD: Final = ("world.min.js", "three.LICENSE.txt")
#: the page of a real person in a live drive, which shares nothing with the others
PERSON: Final = ("person.html", "person.css", "person.js")
#: files of the pages that lie here
OWN: Final = frozenset((*MODULES, *WORLD, *PERSON, "index.html", "page.css"))
#: what a page that a server sends may load: what this server sends, and nothing else
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'"
)

_IMPORT: Final = re.compile(r'^import [^;]+? from "\./[\w.]+";\n', re.MULTILINE)
_EXPORT: Final = re.compile(r"^export (?=(async function|function|class|const) )", re.MULTILINE)


class File(NamedTuple):
    """A file as a server sends it."""

    content: bytes
    kind: str  #: of its content, as HTTP says it


def file(name: str) -> File | None:
    """Return a file of the page by its name; None where there is none of that name."""
    # Whoever asks may ask for any name: only what there is is kept in memory.
    return _read(name) if name in LENT or name in OWN else None


@cache
def _read(name: str) -> File:
    if name in LENT:
        text = uplot.read(LENT[name]).encode()
    else:
        text = (resources.files(__package__) / "web" / name).read_bytes()
    return File(text, KINDS.get(name[name.rindex(".") :], "text/plain; charset=utf-8"))


def one_file(data: dict[str, Any]) -> str:
    """Return the page with its style sheets, scripts and this data inside: it needs no server and no network."""
    library = f"/*\n{_text('uplot.txt')}*/\n{_text('uplot.js')}"
    script = "\n".join(_bundled(name) for name in MODULES)
    style = _text("uplot.css") + _text("page.css")
    # In a script element, only these two could end it or begin a comment.
    held = json.dumps(data, allow_nan=False).replace("<", "\\u003c")
    policy = (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {_hash(library)} {_hash(script)}; "
        "base-uri 'none'; form-action 'none'"
    )
    page = _text("index.html")
    replacements = {
        '<meta charset="utf-8">': f'<meta charset="utf-8">\n<meta http-equiv="Content-Security-Policy" '
        f'content="{policy}">',
        '<link rel="stylesheet" href="uplot.css">\n': "",
        '<link rel="stylesheet" href="page.css">': f"<style>{style}</style>",
        '<script src="uplot.js"></script>\n<script type="module" src="main.js"></script>': "",
        "</body>": f'<script type="application/json" id="vve-data">{held}</script>\n<script>{library}</script>\n'
        f'<script type="module">{script}</script>\n</body>',
    }
    for old, new in replacements.items():
        assert page.count(old) == 1, old
        page = page.replace(old, new)
    return page


def _bundled(name: str) -> str:
    """Return a module without its imports and exports, for one script that holds them all."""
    return _EXPORT.sub("", _IMPORT.sub("", _text(name)))


def _text(name: str) -> str:
    found = file(name)
    assert found is not None, name
    return found.content.decode()


def _hash(content: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()}'"
