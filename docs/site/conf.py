# SPDX-License-Identifier: MIT
"""The documentation as a site, built by `make docs` in `build/docs`.

Its source is the whole tree, so that links between README, the pages of `docs/` and programs are
the same there as where the files are read one by one. The pages of the reference are written at
each build from the public names, one page for each folder of the package.
"""

from __future__ import annotations

import importlib
import inspect
import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

import dolfinx_ffr

TOP = Path(__file__).resolve().parents[2]
REFERENCE = TOP / "docs" / "reference"

project = "dolfinx_ffr"
author = copyright = "the dolfinx_ffr authors"
version = release = dolfinx_ffr.__version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]

root_doc = "README"
include_patterns = ["README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs/*.md", "docs/*/*.md"]
exclude_patterns = [".*", "build", "results"]
myst_heading_anchors = 4

html_theme = "furo"
html_title = f"dolfinx_ffr {release}"
html_extra_path = ["index.html"]  # leads to README.html
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
napoleon_use_rtype = False

#: What README does not show where it is read by itself: the pages in their order.
CONTENTS = """
```{toctree}
:hidden:
:caption: Guide

docs/glossary
docs/scenes
docs/several_load_cases
docs/machine_and_part
docs/from_field_to_part
docs/interchange
docs/speed_and_accuracy
docs/approximate_gradient
docs/hard_cases
docs/peers
```

```{toctree}
:hidden:
:caption: Reference

docs/reference/index
```

```{toctree}
:hidden:
:caption: Measured
:glob:

docs/benchmarks/*
```

```{toctree}
:hidden:
:caption: Project

CHANGELOG
CONTRIBUTING
```
"""


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
        bases = "   :show-inheritance:\n" if thing.__bases__ != (object,) else ""
        return f".. autoclass:: {name}\n   :members:\n{bases}"
    return f".. auto{'function' if callable(thing) else 'data'}:: {name}\n"


def write_reference(app: Sphinx) -> None:
    """Write the reference, one page for each folder; pages that stay the same are left alone."""
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
    pages["index.md"] = "\n".join(lines)
    REFERENCE.mkdir(exist_ok=True)
    for stale in {path.name for path in REFERENCE.glob("*.md")} - set(pages):
        (REFERENCE / stale).unlink()
    for page, text in pages.items():
        path = REFERENCE / page
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


def add_contents(app: Sphinx, docname: str, source: list[str]) -> None:
    """Put the contents of the site into its first page."""
    if docname == root_doc:
        source[0] += CONTENTS


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
    if what == "class" and "Attributes:" in lines:  # Sphinx reads the comments of fields itself
        del lines[lines.index("Attributes:") :]
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
    app.connect("builder-inited", write_reference)
    app.connect("source-read", add_contents)
    app.connect("autodoc-process-signature", readable_signature)
    app.connect("autodoc-process-docstring", keep_formulas, priority=400)  # before napoleon
