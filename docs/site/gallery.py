# SPDX-License-Identifier: MIT
"""The gallery: a card and a page for each demo, from its docstring and its picture.

A demo ``demos/NAME.py`` has a docstring that begins with its title, says ``What you will see:``
and how long it takes (``it takes some minutes``), and a picture ``docs/pictures/NAME.*``.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from PIL import Image

#: Widest thumbnail [pixels]
WIDTH = 420


@dataclass(frozen=True)
class Demo:
    """One demo, as the gallery shows it."""

    program: Path

    @property
    def name(self) -> str:
        """That of the file and of the target of make."""
        return self.program.stem

    @cached_property
    def _parsed(self) -> ast.Module:
        return ast.parse(self.program.read_text())

    @property
    def text(self) -> str:
        """The docstring, Markdown."""
        return ast.get_docstring(self._parsed) or ""

    @property
    def begin(self) -> int:
        """The line from which the program is shown, behind the docstring."""
        return self._parsed.body[1].lineno

    @property
    def title(self) -> str:
        """The heading of the docstring."""
        return self.text.partition("\n")[0].removeprefix("# ").rstrip(".")

    @property
    def sentence(self) -> str:
        """The first sentence of what there is to see."""
        seen = re.search(r"What you will see: (.*?[.!])(?:\s|$)", self.text, re.S)
        if not seen:
            raise ValueError(f"{self.program}: the docstring lacks 'What you will see: ...'")
        found = " ".join(seen[1].split())
        return found[0].upper() + found[1:]

    @property
    def time(self) -> str:
        """How long it takes, in words."""
        found = re.search(r"\btakes\s+([^.;,]*?(?:minutes?|seconds?))", self.text)
        if not found:
            raise ValueError(f"{self.program}: the docstring lacks how long it takes")
        return " ".join(found[1].split())

    @property
    def picture(self) -> Path:
        """The picture with its name."""
        found = sorted((self.program.parents[1] / "docs" / "pictures").glob(f"{self.name}.*"))
        if not found:
            raise ValueError(f"{self.program}: docs/pictures has no picture {self.name}.png")
        return found[0]


def demos(top: Path) -> list[Demo]:
    """All demos: the short program, those in the plane, those in space."""
    found = [Demo(path) for path in (top / "demos").glob("*.py")]
    shown = [demo for demo in found if demo.text.startswith("# ")]
    return sorted(
        shown, key=lambda demo: (demo.name != "short", "spatial" in demo.name, demo.title)
    )


def mentions(top: Path, name: str) -> list[str]:
    """Links to where pages of the site first tell more about a demo."""
    found = []
    for page in sorted([*(top / "docs").glob("*.md"), *(top / "docs" / "how_to").glob("*.md")]):
        before, told, _ = page.read_text().partition(f"demos/{name}.py")
        heading = re.findall(r"^#+ (.+)$", re.sub(r"```.*?```", "", before, flags=re.S), re.M)
        if told and heading:
            anchor = re.sub(r"[^\w\- ]", "", heading[-1].lower()).replace(" ", "-")
            found.append(f"[{heading[-1]}](../{page.relative_to(top / 'docs')}#{anchor})")
    return found


def page(top: Path, demo: Demo) -> str:
    """The page of a demo: picture, text, command, program."""
    more = "".join(f"\n- {link}" for link in mentions(top, demo.name))
    text = demo.text.partition("\n")[2].strip()
    return f"""# {demo.title}

![{demo.title}](../pictures/{demo.picture.name})

{text}

```sh
make demo DEMO={demo.name}    # takes {demo.time}
```
{"More:" if more else ""}
{more}

## Program

```{{literalinclude}} ../../demos/{demo.name}.py
:language: python
:lines: {demo.begin}-
```
"""


def card(demo: Demo) -> str:
    """Thumbnail, title, sentence and time."""
    return f""":::{{figure}} gallery/{demo.name}.png
:alt: {demo.title}
:target: gallery/{demo.name}.html

[**{demo.title}**](gallery/{demo.name}.md)

{demo.sentence} *Takes {demo.time}.*
:::
"""


def pages(top: Path) -> dict[str, str]:
    """The pages of the demos by name of the file."""
    return {f"{demo.name}.md": page(top, demo) for demo in demos(top)}


def cards(top: Path) -> str:
    """What `docs/gallery.md` shows of them."""
    shown = demos(top)
    names = "\n".join(f"gallery/{demo.name}" for demo in shown)
    return f"""::::{{container}} gallery
{chr(10).join(map(card, shown))}
::::

```{{toctree}}
:hidden:

{names}
```
"""


def write_thumbnails(top: Path, folder: Path) -> None:
    """A small picture for each demo, the middle one of a film."""
    for demo in demos(top):
        small = folder / f"{demo.name}.png"
        if small.exists() and small.stat().st_mtime > demo.picture.stat().st_mtime:
            continue
        with Image.open(demo.picture) as picture:
            picture.seek(getattr(picture, "n_frames", 1) // 2)
            shown = picture.convert("RGB")
        shown.thumbnail((WIDTH, WIDTH))
        shown.save(small, optimize=True)
