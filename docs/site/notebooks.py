# SPDX-License-Identifier: MIT
"""The notebooks as pages: their text and programs, with the file to download."""

from __future__ import annotations

import json
from pathlib import Path


def cells(notebook: Path) -> list[tuple[str, str]]:
    """Kind and text of each cell."""
    found = json.loads(notebook.read_text())["cells"]
    return [(cell["cell_type"], "".join(cell["source"])) for cell in found]


def page(notebook: Path) -> str:
    """A notebook as Markdown; its first cell has the heading."""
    shown = [
        text if kind == "markdown" else f"```python\n{text}\n```" for kind, text in cells(notebook)
    ]
    shown.insert(1, f"[Download this notebook]({notebook.name}); it runs in a minute.")
    return "\n\n".join(shown) + "\n"


def pages(folder: Path) -> dict[str, str]:
    """All pages by name of the file."""
    return {f"{each.stem}.md": page(each) for each in sorted(folder.glob("*.ipynb"))}


def listed(folder: Path) -> str:
    """What `docs/notebooks.md` shows of them."""
    found = sorted(folder.glob("*.ipynb"))
    titles = [cells(each)[0][1].partition("\n")[0].removeprefix("# ") for each in found]
    links = [
        f"- [{title}](notebooks/{each.stem}.md)" for title, each in zip(titles, found, strict=True)
    ]
    names = [f"notebooks/{each.stem}" for each in found]
    return "\n".join([*links, "", "```{toctree}", ":hidden:", "", *names, "```", ""])
