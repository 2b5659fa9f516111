"""What MkDocs is told beside `mkdocs.yml`: pages from outside docs/, notebooks as pages, examples in docstrings.

A page of docs/ links to other files of the repository by their places there. On the site the content of docs/ lies at
the root and the other files lie where they lie in the repository, so links are rewritten here, and nowhere by hand.
"""

from __future__ import annotations

import os
import posixpath
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import griffe
import nbformat
from mkdocs.structure.files import File, Files
from nbconvert import MarkdownExporter
from nbconvert.preprocessors import ExecutePreprocessor

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.pages import Page

REPOSITORY = Path(__file__).parent
#: pages that lie outside docs/: from their places in the repository to those on the site
SITE_PATHS = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "networks/README.md": "networks.md",
    "routes/README.md": "routes.md",
}
#: set to anything, the notebooks are run, which takes minutes, and shown with what they put out
RUN = "VVE_RUN_NOTEBOOKS"
#: of a page, the target of a link or a picture and its anchor
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)#\s]+)(?=[)#])")
#: of a page as HTML, the names in a table
NAME = re.compile(r"(?<=<td><code>)[^<\n]{12,}(?=</code>)")
#: of a table of pandas in a notebook, what keeps it from looking like the site's own
PANDAS = re.compile(r"<style scoped>.*?</style>\n?|(?<=<table) border=\"1\" class=\"dataframe\"", re.DOTALL)
#: stands under the title of a notebook
OF_A_NOTEBOOK = """
!!! note "A notebook"

    `vve-sumo notebooks nb` copies it to `nb/`; `pip install 'vve-sumo[notebooks]' && jupyter lab nb` opens it.
    [Download]({name}.ipynb){said}
"""
NOT_RUN = ". What its cells put out is not shown here: run it."


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that lie outside docs/, and the files that a page links to."""
    for place, there in SITE_PATHS.items():
        files.append(File.generated(config, there, abs_src_path=str(REPOSITORY / place)))
    for notebook in sorted((REPOSITORY / "notebooks").glob("*.ipynb")):
        for name, content in converted(notebook).items():
            files.append(File.generated(config, f"notebooks/{name}", content=content))
        _add_file(files, config, f"notebooks/{notebook.name}")
    for page in files.documentation_pages():
        for place in _linked(page.content_string, _place(page.src_uri)):
            if not place.startswith("docs/") and not place.endswith((".md", ".ipynb")):
                _add_file(files, config, place)
    return files


def _add_file(files: Files, config: MkDocsConfig, place: str) -> None:
    if files.get_file_from_path(place) is None and (REPOSITORY / place).is_file():
        files.append(File.generated(config, place, abs_src_path=str(REPOSITORY / place)))


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead the links of a page to where their files lie on the site."""
    place = _place(page.file.src_uri)
    here = posixpath.dirname(page.file.src_uri)

    def there(link: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(place), link[1]))
        return posixpath.relpath(_site_path(target), here or ".")

    return LINK.sub(there, markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Load pictures when they are scrolled to, and let long names break after a dot, slash or underscore alone."""
    html = html.replace("<img ", '<img loading="lazy" ')
    return NAME.sub(lambda code: re.sub(r"([./_])(?=\w)", r"\1<wbr>", code[0]), html)


def _site_path(place: str) -> str:
    """Return where a file of the repository lies on the site."""
    return SITE_PATHS.get(place) or re.sub(r"^(notebooks/.*)\.ipynb$", r"\1.md", place.removeprefix("docs/"))


def _place(site_path: str) -> str:
    """Return where a page of the site lies in the repository."""
    for place, there in SITE_PATHS.items():
        if site_path == there:
            return place
    return re.sub(r"\.md$", ".ipynb", site_path) if site_path.startswith("notebooks/") else f"docs/{site_path}"


def _linked(markdown: str, place: str) -> Iterator[str]:
    """Yield the places in the repository that a page at `place` links to."""
    for link in LINK.findall(markdown):
        yield posixpath.normpath(posixpath.join(posixpath.dirname(place), link))


def converted(notebook: Path) -> dict[str, str | bytes]:
    """Return the page of a notebook and its pictures, by name; run first where `RUN` is set."""
    book = nbformat.read(notebook, as_version=4)
    run = bool(os.environ.get(RUN))
    with tempfile.TemporaryDirectory() as folder:
        if run:
            ExecutePreprocessor(timeout=1800, kernel_name="python3").preprocess(book, {"metadata": {"path": folder}})
    markdown, resources = MarkdownExporter().from_notebook_node(
        book, {"unique_key": notebook.stem, "output_files_dir": f"{notebook.stem}_files"}
    )
    title, _, rest = PANDAS.sub("", markdown).lstrip().partition("\n")
    note = OF_A_NOTEBOOK.format(name=notebook.stem, said="." if run else NOT_RUN)
    pictures = {name: bytes(content) for name, content in resources["outputs"].items()}
    return {f"{notebook.stem}.md": f"{title}\n{note}\n{rest}", **pictures}


class Docstrings(griffe.Extension):
    """Makes Markdown of our docstrings.

    Examples are set as code, for `>>>` would be a quotation. The fields of what is data and little else, each with the
    comment beside it, become a table.
    """

    def on_class_members(self, *, cls: griffe.Class, **_: Any) -> None:
        """List the fields of a dataclass, a named tuple or an enumeration."""
        bases = {str(base).rpartition(".")[2] for base in cls.bases}
        if cls.docstring is None or not (cls.labels & {"dataclass"} or bases & {"NamedTuple", "StrEnum"}):
            return
        said = {name: one.docstring.value for name, one in cls.attributes.items() if one.docstring is not None}
        fields = "".join(f"\n    {name}: {' '.join(text.split())}" for name, text in said.items())
        cls.docstring.value += f"\n\nAttributes:{fields}" if fields else ""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Put every paragraph of an object's docstring that begins with `>>>` between fences."""
        if obj.docstring is not None and ">>>" in obj.docstring.value:
            obj.docstring.value = re.sub(
                r"^>>> .*?(?=\n\n|\Z)", r"```pycon\n\g<0>\n```", obj.docstring.value, flags=re.MULTILINE | re.DOTALL
            )
