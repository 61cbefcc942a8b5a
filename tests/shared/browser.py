# SPDX-License-Identifier: MIT
"""Debian's Chromium without a screen: what a page shows, asks the network for, and complains of."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Put at the end of a copy of the page; its answers are in the document that the browser dumps
_PROBE = """
<pre id="probe"></pre>
<script>
addEventListener("load", () => {
  const root = document.documentElement;
  document.getElementById("probe").textContent = JSON.stringify({
    text: document.body.innerText,
    title: document.title,
    images: [...document.images].map(i => [i.alt, i.complete ? i.naturalWidth : 0]),
    requested: performance.getEntriesByType("resource").map(e => e.name)
      .filter(name => !name.startsWith("data:")),
    width: root.scrollWidth, window: root.clientWidth,
    headings: [...document.querySelectorAll("h1, h2, h3")].map(h => h.tagName + " " + h.innerText),
    columns: [...document.querySelectorAll("td.number")].map(c => c.getBoundingClientRect().width),
  });
});
</script>
"""
_POLICY = "default-src 'none'; "


@dataclass(frozen=True)
class Seen:
    """A page as the browser has it."""

    found: dict[str, Any]  #: What the probe has found
    console: list[str]  #: Messages on its console
    requests: list[str]  #: Addresses that it asked for, the file apart


def look(page: Path, place: Path, width: int = 1280) -> Seen:
    """Load a page with a probe in it, in a window of some width [pixels]."""
    text = page.read_text(encoding="utf-8")
    assert _POLICY in text
    probed = place / "probed.html"
    allowed = text.replace(_POLICY, f"{_POLICY}script-src 'unsafe-inline'; ")
    probed.write_text(allowed.replace("</body>", _PROBE + "</body>"), encoding="utf-8")
    done, requests = _run(probed, place, width, "--dump-dom")
    answer = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.S)
    assert answer, done.stderr
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return Seen(json.loads(html.unescape(answer[1])), console, requests)


def printed(page: Path, place: Path) -> tuple[int, list[str]]:
    """Print a page as it is: number of sheets, and messages on the console."""
    file = place / "page.pdf"
    done, _ = _run(page, place, 1280, f"--print-to-pdf={file}")
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return len(re.findall(rb"/Type /Page\b", file.read_bytes())), console


def _run(
    page: Path, place: Path, width: int, *what: str
) -> tuple[subprocess.CompletedProcess[str], list[str]]:
    names = ("chromium-headless-shell", "chromium")
    program = next((computed for name in names if (computed := shutil.which(name))), None)
    assert program, f"none of {names} is installed: run make setup-tests"
    log = place / "network.json"
    quiet = "no-sandbox disable-gpu disable-quic no-first-run disable-background-networking"
    quiet += " disable-component-update disable-sync disable-dev-shm-usage disable-extensions"
    done = subprocess.run(
        [
            program,
            "--headless",
            *(f"--{option}" for option in quiet.split()),
            "--host-resolver-rules=MAP * ~NOTFOUND",
            f"--user-data-dir={place / 'profile'}",
            f"--window-size={width},900",
            "--enable-logging=stderr",
            f"--log-net-log={log}",
            *what,
            page.as_uri(),
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    addresses = set(re.findall(r'"url":"([^"]*)"', log.read_text()))
    return done, sorted(a for a in addresses if not a.startswith(("file:", "data:")))
