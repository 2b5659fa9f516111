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
#: pages that lie outside docs/, by their places in the repository
OUTSIDE = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "networks/README.md", "routes/README.md")
#: set to anything, the notebooks are run, which takes minutes, and shown with what they put out
RUN = "VVE_RUN_NOTEBOOKS"
#: of a page, the target of a link or a picture and its anchor
LINK = re.compile(r"(?<=\]\()(?![a-z]+:|#)([^)#\s]+)(?=[)#])")
#: stands under the title of a notebook
OF_A_NOTEBOOK = """
!!! note "A notebook"

    `vve-sumo notebooks nb` copies it to `nb/`; `pip install 'vve-sumo[notebooks]' && jupyter lab nb` opens it.
    [Download]({name}.ipynb){said}
"""
NOT_RUN = ". What its cells put out is not shown here: run it."


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that lie outside docs/, and the files that a page links to."""
    for place in OUTSIDE:
        files.append(File.generated(config, _site_path(place), abs_src_path=str(REPOSITORY / place)))
    for notebook in sorted((REPOSITORY / "notebooks").glob("*.ipynb")):
        for name, content in _converted(notebook).items():
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
    """Load pictures when they are scrolled to."""
    return html.replace("<img ", '<img loading="lazy" ')


def _site_path(place: str) -> str:
    """Return where a file of the repository lies on the site."""
    if place == "README.md":
        return "index.md"
    return re.sub(r"^(notebooks/.*)\.ipynb$", r"\1.md", place.removeprefix("docs/"))


def _place(site_path: str) -> str:
    """Return where a page of the site lies in the repository."""
    if site_path == "index.md":
        return "README.md"
    if site_path.startswith("notebooks/"):
        return re.sub(r"\.md$", ".ipynb", site_path)
    return site_path if site_path in OUTSIDE else f"docs/{site_path}"


def _linked(markdown: str, place: str) -> Iterator[str]:
    """Yield the places in the repository that a page at `place` links to."""
    for link in LINK.findall(markdown):
        yield posixpath.normpath(posixpath.join(posixpath.dirname(place), link))


def _converted(notebook: Path) -> dict[str, str | bytes]:
    """Return the page of a notebook and its pictures, by name; run first where `RUN` is set."""
    book = nbformat.read(notebook, as_version=4)
    run = bool(os.environ.get(RUN))
    with tempfile.TemporaryDirectory() as folder:
        if run:
            ExecutePreprocessor(timeout=1800, kernel_name="python3").preprocess(book, {"metadata": {"path": folder}})
    markdown, resources = MarkdownExporter().from_notebook_node(
        book, {"unique_key": notebook.stem, "output_files_dir": f"{notebook.stem}_files"}
    )
    title, _, rest = markdown.lstrip().partition("\n")
    note = OF_A_NOTEBOOK.format(name=notebook.stem, said="." if run else NOT_RUN)
    pictures = {name: bytes(content) for name, content in resources["outputs"].items()}
    return {f"{notebook.stem}.md": f"{title}\n{note}\n{rest}", **pictures}


class Examples(griffe.Extension):
    """Sets the examples of docstrings as code: in Markdown `>>>` would be a quotation."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Put every paragraph of an object's docstring that begins with `>>>` between fences."""
        if obj.docstring is not None and ">>>" in obj.docstring.value:
            obj.docstring.value = re.sub(
                r"^>>> .*?(?=\n\n|\Z)", r"```pycon\n\g<0>\n```", obj.docstring.value, flags=re.MULTILINE | re.DOTALL
            )
