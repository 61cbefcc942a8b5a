# SPDX-License-Identifier: MIT
"""What the pages point at is there: files, headings, commands and public names."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest
from shared import TOP

import dolfinx_ffr

PAGES = [
    *(TOP / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")),
    *sorted((TOP / "docs").glob("*.md")),
    *(
        page
        for folder in ("benchmarks", "how_to", "site", "tutorial")
        for page in sorted((TOP / "docs" / folder).glob("*.md"))
    ),
]
#: Folders that paths in the text begin with.
FOLDERS = {"benchmarks", "demos", "docs", "install", "src", "tests"}


def prose(page: Path) -> str:
    """The text of a page without its programs."""
    return re.sub(r"^(```+).*?^\1\s*$", "", page.read_text(), flags=re.M | re.S)


@cache
def anchors(page: Path) -> set[str]:
    """The headings of a page as GitHub and the site name them in links."""
    links: set[str] = set()
    for heading in re.findall(r"^#+ +(.+?) *$", prose(page), re.M):
        text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")
        while slug in links:
            slug += "-1"
        links.add(slug)
    return links


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(TOP)))
def test_links_and_paths_lead_somewhere(page: Path) -> None:
    faults = []
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"(https?|mailto):", target):
            continue
        name, _, anchor = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        if not path.exists():
            faults.append(f"{target}: no such file")
        elif anchor and anchor not in anchors(path):
            faults.append(f"{target}: no such heading")
    for path in re.findall(r"`((?:\w+/)+[\w.]*)`", prose(page)):
        if path.split("/")[0] in FOLDERS and not (TOP / path).exists():
            faults.append(f"{path}: no such path")
    assert not faults


def test_make_targets_in_the_text_exist() -> None:
    targets = set(re.findall(r"^([a-z0-9-]+):.*## ", (TOP / "Makefile").read_text(), re.M))
    named = {
        target
        for page in PAGES
        for target in re.findall(r"(?:^|`)make ([a-z][a-z0-9-]+)", page.read_text(), re.M)
    }
    assert named <= targets
    assert "docs" in targets


def test_workflows_and_paper_name_what_there_is() -> None:
    """Targets of make in the workflows, and references of the paper."""
    targets = set(re.findall(r"^([a-z0-9-]+):", (TOP / "Makefile").read_text(), re.M))
    workflows = "".join(path.read_text() for path in (TOP / ".github" / "workflows").glob("*.yml"))
    called = set(re.findall(r"run: make ([a-z0-9-]+)", workflows))
    assert {"test", "docs", "lint"} <= called <= targets
    cited = set(re.findall(r"@(\w+)", (TOP / "paper" / "paper.md").read_text()))
    listed = set(re.findall(r"^@\w+\{(\w+),", (TOP / "paper" / "paper.bib").read_text(), re.M))
    assert cited == listed


def test_selection_for_other_releases_exists() -> None:
    script = (TOP / "tests" / "run.sh").read_text()
    selected = re.findall(r"(tests/[\w/]+/\w+\.py|tests/test_\w+\.py)(?:::(\w+))?", script)
    assert len(selected) > 5
    for path, function in selected:
        text = (TOP / path).read_text()
        assert not function or f"\ndef {function}(" in text, f"{path}::{function}"


def test_one_version_everywhere() -> None:
    version = dolfinx_ffr.__version__
    assert f'\nversion = "{version}"\n' in (TOP / "pyproject.toml").read_text()
    assert f"\nversion: {version}\n" in (TOP / "CITATION.cff").read_text()
    assert f"\n## {version}" in (TOP / "CHANGELOG.md").read_text()
