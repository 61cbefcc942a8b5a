# SPDX-License-Identifier: MIT
"""Violations of sizes, rims and outlines by finished parts, found from the parts alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ..part import (
    Part,
    PartViolation,
    Solid,
    free_ends,
    outline_violations,
    size_violations,
)
from ..problem import Problem


def part_violations(
    problem: Problem,
    parts: Mapping[str, Part | Solid],
    sizes: Mapping[str, tuple[float, float]],
    rims: Mapping[str, tuple[float, float]],
) -> dict[str, PartViolation]:
    """Violations of parts, by their names.

    ``sizes`` are the minimum member and minimum gap of parts for which the user gives sizes;
    ``rims`` the width of the rims of drawn holes of all parts, and their minimum member [m].
    """
    violations = {}
    for name, part in parts.items():
        for violation in outline_violations(part, *rims[name]):
            violations[f"{name}: {violation.name}"] = violation
        for violation in _of_sizes(problem, name, part, *sizes[name]) if name in sizes else ():
            violations[f"{name}: {violation.name}"] = violation
    return violations


def _of_sizes(
    problem: Problem, name: str, part: Part | Solid, member: float, gap: float
) -> Iterator[PartViolation]:
    """Violations of minimum sizes, and struts that end free."""
    yield from size_violations(part, member, gap)
    if isinstance(part, Part) and not part.web:
        markers = problem.flexible[name].markers.values()
        bearings = np.array([marker.position for marker in markers]).reshape(-1, 2)
        for place in free_ends(part, member, bearings):
            place_text = "({:.4g}, {:.4g}) mm".format(*(1e3 * place))
            remedy = "take more steps of the boundary, a larger minimum_member, or another start"
            text = f"a strut ends free near {place_text} and carries nothing: {remedy}"
            yield PartViolation(f"strut that ends free near {place_text}", 1.0, text)
