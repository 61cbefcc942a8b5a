# SPDX-License-Identifier: MIT
"""The gallery: a card and a page for each demo and each example of a scene file.

A demo ``demos/NAME.py`` has a docstring that begins with its title, says ``What you will see:``
and how long it takes (``it takes some minutes``), and a picture ``docs/pictures/NAME.*``. A scene
file has a title, comments above it, the first of which is a sentence, the time behind the command
that designs it, and a picture ``docs/pictures/example_NAME.*``.
"""

from __future__ import annotations

import ast
import re
import tomllib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from PIL import Image

TOP = Path(__file__).resolve().parents[2]
EXAMPLES = TOP / "src" / "dolfinx_ffr" / "scene_file" / "examples"
#: Widest thumbnail [pixels]
WIDTH = 420


@dataclass(frozen=True)
class Demo:
    """One demo, as the gallery shows it."""

    program: Path
    language: ClassVar[str] = "python"

    @property
    def name(self) -> str:
        """That of its page and of its picture."""
        return self.program.stem

    @property
    def command(self) -> str:
        """What runs it."""
        return f"make demo DEMO={self.name}"

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
        found = sorted((TOP / "docs" / "pictures").glob(f"{self.name}.*"))
        if not found:
            raise ValueError(f"{self.program}: docs/pictures has no picture {self.name}.png")
        return found[0]


class Example(Demo):
    """A scene file."""

    language = "toml"

    @property
    def name(self) -> str:
        return f"example_{self.program.stem}"

    @property
    def command(self) -> str:
        stem = self.program.stem
        return f"dolfinx_ffr new {stem} && dolfinx_ffr design {stem}.toml"

    @property
    def text(self) -> str:
        above = self.program.read_text().partition("\n\n")[0]
        return re.sub(r"^# ?", "", above, flags=re.M)

    @property
    def begin(self) -> int:
        return len(self.text.splitlines()) + 2

    @property
    def title(self) -> str:
        return str(tomllib.loads(self.program.read_text())["title"])

    @property
    def sentence(self) -> str:
        return self.text.partition("\n\n")[0].replace("\n", " ")

    @property
    def time(self) -> str:
        found = re.search(r"dolfinx_ffr design \S+ +# (.+)", self.text)
        if not found:
            raise ValueError(f"{self.program}: the comments lack how long the design takes")
        return found[1]


def demos() -> list[Demo]:
    """All demos: the short program, those in the plane, those in space."""
    found = [Demo(path) for path in (TOP / "demos").glob("*.py")]
    shown = [demo for demo in found if demo.text.startswith("# ")]
    return sorted(
        shown, key=lambda demo: (demo.name != "short", "spatial" in demo.name, demo.title)
    )


def examples() -> list[Demo]:
    """All scene files that the package brings."""
    return [Example(path) for path in sorted(EXAMPLES.glob("*.toml"))]


def mentions(name: str) -> list[str]:
    """Links to where pages of the site first tell more about a demo."""
    found = []
    for page in sorted([*(TOP / "docs").glob("*.md"), *(TOP / "docs" / "how_to").glob("*.md")]):
        before, told, _ = page.read_text().partition(f"demos/{name}.py")
        heading = re.findall(r"^#+ (.+)$", re.sub(r"```.*?```", "", before, flags=re.S), re.M)
        if told and heading:
            anchor = re.sub(r"[^\w\- ]", "", heading[-1].lower()).replace(" ", "-")
            found.append(f"[{heading[-1]}](../{page.relative_to(TOP / 'docs')}#{anchor})")
    return found


def page(demo: Demo) -> str:
    """The page of a demo: picture, text, command, program."""
    more = "".join(f"\n- {link}" for link in mentions(demo.name))
    text = demo.text.partition("\n")[2].strip() if type(demo) is Demo else demo.text
    return f"""# {demo.title}

![{demo.title}](../pictures/{demo.picture.name})

{text}

```sh
{demo.command}    # takes {demo.time}
```
{"More:" if more else ""}
{more}

## Program

```{{literalinclude}} ../../{demo.program.relative_to(TOP)}
:language: {demo.language}
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


def pages() -> dict[str, str]:
    """The pages of demos and examples by name of the file."""
    return {f"{demo.name}.md": page(demo) for demo in demos() + examples()}


def cards() -> str:
    """What `docs/gallery.md` shows of them."""
    names = "\n".join(f"gallery/{demo.name}" for demo in demos() + examples())
    return f"""::::{{container}} gallery
{chr(10).join(map(card, demos()))}
::::

## Scene files

`dolfinx_ffr new NAME` writes one of these, `dolfinx_ffr design NAME.toml` makes its part:
[a part without a program](command.md).

::::{{container}} gallery
{chr(10).join(map(card, examples()))}
::::

```{{toctree}}
:hidden:

{names}
```
"""


def write_thumbnails(folder: Path) -> None:
    """A small picture for each, the middle one of a film."""
    for demo in demos() + examples():
        small = folder / f"{demo.name}.png"
        if small.exists() and small.stat().st_mtime > demo.picture.stat().st_mtime:
            continue
        with Image.open(demo.picture) as picture:
            picture.seek(getattr(picture, "n_frames", 1) // 2)
            shown = picture.convert("RGB")
        shown.thumbnail((WIDTH, WIDTH))
        shown.save(small, optimize=True)
