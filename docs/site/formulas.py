# SPDX-License-Identifier: MIT
"""Formulas as MathML, which every browser sets by itself: no scripts, fonts or network."""

from __future__ import annotations

import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

#: What shows code as it is, where a dollar may stand
_CODE = re.compile(r"<(pre|code|script|style)\b.*?</\1>", re.S)
_RAW = re.compile(r"\$[^$\n]*\$?|\\[(\[][^\n]*")


def set_inline(writer: nodes.NodeVisitor, node: nodes.math) -> None:
    """Write a formula within a line."""
    writer.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def set_block(writer: nodes.NodeVisitor, node: nodes.math_block) -> None:
    """Write a formula of its own."""
    writer.body.append(tex2mathml(node.astext(), as_block=True))
    raise nodes.SkipNode


def raw(body: str) -> list[str]:
    """Formulas that a page shows as they were typed."""
    text = re.sub(r"<[^>]*>", "", _CODE.sub("", body))
    return _RAW.findall(text)
