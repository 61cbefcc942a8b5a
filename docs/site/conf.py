# SPDX-License-Identifier: MIT
"""The documentation as a site, built by `make docs` in `build/docs`.

Its source is the whole tree, so that links between the pages of `docs/` and programs are the same
there as where the files are read one by one. Three folders are written at each build: the reference
from the public names, one page for each folder of the package, the gallery from the demos, and
the pages of the notebooks.
"""

from __future__ import annotations

import importlib
import inspect
import re
import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

import dolfinx_ffr
from dolfinx_ffr.documentation import Shown

sys.path.insert(0, str(Path(__file__).parent))
import formulas
import gallery
import notebooks

TOP = Path(__file__).resolve().parents[2]

project = "dolfinx_ffr"
author = copyright = "the dolfinx_ffr authors"
version = release = dolfinx_ffr.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]

root_doc = "docs/site/index"
include_patterns = ["CHANGELOG.md", "CONTRIBUTING.md", "docs/*.md", "docs/*/*.md"]
exclude_patterns = [".*", "build", "results"]
myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath", "colon_fence"]
html_math_renderer = "mathml"

html_theme = "furo"
html_title = f"dolfinx_ffr {release}"
html_extra_path = ["index.html"]  # leads to the first page
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False

default_role = "py:obj"  # single backticks: code, and a link where it names something public
suppress_warnings = ["ref.python"]  # a letter may name fields of several classes
python_use_unqualified_type_names = True
add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_type_aliases = {name: name for name in ("ArrayLike", "Densities")}
maximum_signature_line_length = 90
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # signatures have the types
napoleon_use_rtype = False


def public_names() -> dict[str, list[str]]:
    """The public names by folder, or module beside the folders."""
    names: dict[str, list[str]] = {}
    for folder in sorted(dolfinx_ffr._ROOMS):
        inside = dolfinx_ffr._BY_FOLDER.get(folder, [])
        if folder in ("plotting", "verification"):
            found = vars(importlib.import_module(f"dolfinx_ffr.{folder}"))
            own = f"dolfinx_ffr.{folder}"
            inside = [n for n, t in found.items() if getattr(t, "__module__", "").startswith(own)]
        names[folder] = [f"dolfinx_ffr.{name}" for name in dolfinx_ffr._FOLDERS.get(folder, [])]
        names[folder] += [f"dolfinx_ffr.{folder}.{name}" for name in inside]
    return names


def directive(name: str) -> str:
    """The lines that document one name."""
    module, _, attribute = name.rpartition(".")
    thing = getattr(importlib.import_module(module), attribute)
    if inspect.isclass(thing):
        alone = thing.__bases__ in ((object,), (Shown,))
        bases = "" if alone else "   :show-inheritance:\n"
        return f".. autoclass:: {name}\n   :members:\n{bases}"
    return f".. auto{'function' if callable(thing) else 'data'}:: {name}\n"


def reference() -> dict[str, str]:
    """The pages of the reference, one for each folder."""
    names = public_names()
    pages = {
        f"{folder}.md": f"# {folder}\n\n"
        + (inspect.getdoc(importlib.import_module(f"dolfinx_ffr.{folder}")) or "").split("\n\n")[0]
        + "\n\n```{eval-rst}\n"
        + "\n".join(map(directive, sorted(found)))
        + "```\n"
        for folder, found in names.items()
    }
    lines = ["# Reference", "", "All public names, by the folder that they live in.", ""]
    for folder, found in sorted(names.items()):
        listed = ", ".join(f"`{name.rpartition('.')[2]}`" for name in sorted(found))
        lines.append(f"* [{folder}]({folder}.md): {listed}")
    lines += ["", "```{toctree}", ":hidden:", "", *sorted(names), "```", ""]
    return pages | {"index.md": "\n".join(lines)}


def write_pages(app: Sphinx) -> None:
    """Write what is made at each build; pages that stay the same are left alone."""
    made = {
        "reference": reference(),
        "gallery": gallery.pages(),
        "notebooks": notebooks.pages(TOP / "docs" / "notebooks"),
    }
    for name, pages in made.items():
        folder = TOP / "docs" / name
        folder.mkdir(exist_ok=True)
        for stale in {path.name for path in folder.glob("*.md")} - set(pages):
            (folder / stale).unlink()
        for page, text in pages.items():
            path = folder / page
            if not path.exists() or path.read_text() != text:
                path.write_text(text)
    gallery.write_thumbnails(TOP / "docs" / "gallery")


def fill_in(app: Sphinx, page: str, source: list[str]) -> None:
    """Put what is made at each build into the pages that lead to it."""
    if page == "docs/tutorial/index":
        source[0] += "\n```{toctree}\n:hidden:\n:glob:\n\n[1-9]_*\n```\n"
    if page == "docs/gallery":
        source[0] += gallery.cards()
    if page == "docs/notebooks":
        source[0] += notebooks.listed(TOP / "docs" / "notebooks")


def refuse_raw_formulas(
    app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: Any
) -> None:
    """Warn of formulas that a page shows as they were typed."""
    for found in formulas.raw(context.get("body", "")):
        logging.getLogger(__name__).warning("%s: a formula is not set: %s", page, found)


def readable_signature(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, signature: str, result: str
) -> tuple[str, str] | None:
    """A signature that can be parsed, and is then set over several lines."""
    if signature and "<factory>" in signature:
        return signature.replace("<factory>", "..."), result
    return None


def keep_formulas(
    app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    """Set formulas as they are typed: indented paragraphs, and bars outside of backticks."""
    if what in ("attribute", "property"):
        lines[:0] = ["..", ""]  # an empty comment, or the text before a colon is taken for a type
    typed: list[str] = []
    formula, above = False, ""
    for line in lines:
        if not line.startswith("    ") and line.strip():
            formula = False
        elif line.strip() and not formula and typed and not typed[-1].strip():
            formula = not above.startswith((" ", "* ", "- ", ".. "))
            typed += ["::", ""] if formula else []
        above = line if line.strip() else above
        bars = re.sub(r"(`+.*?`+)|\|", lambda found: found[1] or r"\|", line)
        typed.append(line if formula else bars)
    lines[:] = typed


def setup(app: Sphinx) -> None:
    """Connect what this configuration does itself."""
    set_math = (formulas.set_inline, None), (formulas.set_block, None)
    app.add_html_math_renderer("mathml", *set_math)
    app.connect("builder-inited", write_pages)
    app.connect("source-read", fill_in)
    app.connect("html-page-context", refuse_raw_formulas)
    app.connect("autodoc-process-signature", readable_signature)
    app.connect("autodoc-process-docstring", keep_formulas, priority=400)  # before napoleon
