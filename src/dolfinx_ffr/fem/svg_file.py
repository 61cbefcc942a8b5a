# SPDX-License-Identifier: MIT
"""Visible curves of SVG files, by svgelements, in metres, y upwards.

The library does not know symbols, views within views, lengths in per cent, and elements that are
drawn only where another refers to them: a copy is made plain beforehand (`_Plain`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError, SubElement, parse, tostring

import numpy as np

from ..arrays import Array
from ..limits import MOST_CURVES, check_count
from .curves import Arc, Curve, Drawn, Line, Spline

#: Physical units, and pixels [mm]
_PHYSICAL = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72.0, "pc": 25.4 / 6.0}
_UNITS = {**_PHYSICAL, "px": 25.4 / 96.0, "": 25.4 / 96.0}
#: Points by which ellipses are taken
_POINTS = 65
#: Relative accuracy with which an ellipse is a circle
_ROUND = 1e-9
#: Elements that are not drawn where they stand
_UNSEEN = {"clipPath", "defs", "filter", "foreignObject", "marker", "mask", "metadata", "pattern"}
_UNSEEN |= {"style", "symbol"}
_REFERENCES = ("href", "{http://www.w3.org/1999/xlink}href")
_SIDES = ("width", "height")
#: Attributes that place a view
_FRAME = {"x", "y", "width", "height", "viewBox", "preserveAspectRatio"}
#: Lengths in per cent of the width of the view (0), its height (1), or its mean diagonal (2)
_ALONG = dict.fromkeys(("x", "width", "cx", "rx", "x1", "x2"), 0)
_ALONG |= {**dict.fromkeys(("y", "height", "cy", "ry", "y1", "y2"), 1), "r": 2}
#: A number of a path, which may follow another without a space
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
#: A mark that the library takes for a part of the value
_IMPORTANT = re.compile(r"\s*!\s*important")

Size = tuple[float, float]
Box = tuple[float, float, float, float]
#: Width and height of a view in units of its coordinates, None where that is not known
Whole = Sequence[float | None]
Above = tuple[Element, ...]
Sides = Mapping[str, str]
_NO_SIDES: Sides = {}


def read_svg(path: Path, scale: float | None, layers: Collection[str] | None) -> list[Drawn]:
    """Read the visible curves of an SVG file.

    The unit of the file is ``scale`` [m], or that of its page. Only shapes whose ids or labels, or
    those of their groups, are among ``layers`` are looked at; None stands for all.
    """
    import svgelements

    if not hasattr(svgelements, "Use"):
        raise ImportError(
            f"outline {path}: SVG files need svgelements 1.9, and Debian 13 has an older one: save "
            "the drawing as DXF, or work in an environment with a newer one (python3 -m venv "
            "--system-site-packages FOLDER; FOLDER/bin/pip install 'svgelements>=1.9')"
        )
    unreadable = f"outline {path}: no SVG file that can be read"
    try:
        root = parse(path).getroot()
    except (ParseError, OSError, LookupError, ValueError) as error:
        raise ValueError(f"{unreadable}: {error}") from error
    if _name(root) != "svg":
        raise ValueError(f"{unreadable}: it begins with <{_name(root)}>")
    across, down = (scale, scale) if scale else _metres(path, root)
    # numbers in the file's own coordinates, which the size of the page does not move
    text = StringIO(tostring(_Plain(path, root).copy, encoding="unicode"))
    try:
        # the library itself would not skew arcs correctly
        svg = svgelements.SVG.parse(text, reify=False, on_error="raise")
    except (ValueError, TypeError, IndexError) as error:
        raise ValueError(f"{unreadable}: {error}") from error
    found: list[Drawn] = []
    for shape, names in _shapes(path, svg, frozenset()):
        if layers is not None and names.isdisjoint(layers):
            continue
        m = shape.transform
        placed = np.array([[across * m.a, across * m.c], [-down * m.b, -down * m.d]])
        moved = np.array([across * m.e, -down * m.f])
        found += [Drawn(c, names) for c in _of_path(svgelements.Path(shape), placed, moved)]
    return found


def _metres(path: Path, root: Element) -> Size:
    """The lengths of a unit of an SVG file's coordinates along x and y [m]."""
    import svgelements

    sides = [root.get(side, "") for side in _SIDES]
    lengths = [_length(side) for side in sides]
    if not any(side.strip().endswith(tuple(_PHYSICAL)) for side in sides):
        raise ValueError(
            f"outline {path}: the file does not say its unit (width = {root.get('width')!r}); give "
            "unit='mm'"
        )
    box = _box(path, root)
    if box is None:
        return 1e-3 * _UNITS[""], 1e-3 * _UNITS[""]
    scales = [side / of for side, of in zip(lengths, box[2:], strict=True) if side is not None]
    if min(scales) <= 0.0:
        raise ValueError(f"outline {path}: the page has no size; give unit='mm'")
    size = scales[0] * box[2], scales[-1] * box[3]
    view = svgelements.Matrix(_view((0.0, 0.0), size, box, root))
    return 1e-3 * float(view.a), 1e-3 * float(view.d)


def _length(text: str | None, whole: float | None = None) -> float | None:
    """A length [mm], also a share of a ``whole`` in per cent; None where it is not known."""
    match = re.fullmatch(r"\s*([-+.\deE]+?)\s*([a-z]*|%)\s*", text or "")
    if match and match[2] == "%":
        return None if whole is None else float(match[1]) / 100.0 * whole
    return float(match[1]) * _UNITS[match[2]] if match and match[2] in _UNITS else None


def _units(text: str | None, whole: float | None = None) -> float | None:
    """A length in units of coordinates, 96 to an inch; as `_length`."""
    found = _length(text, None if whole is None else _UNITS[""] * whole)
    return None if found is None else found / _UNITS[""]


def _box(path: Path, element: Element) -> Box | None:
    """The viewBox of an element, None if it has none."""
    text = element.get("viewBox", "").strip()
    if not text:
        return None
    try:
        x, y, width, height = (float(number) for number in re.split(r"[\s,]+", text))
    except ValueError:
        width = height = math.nan
    if not (0.0 < width < math.inf and 0.0 < height < math.inf):
        raise ValueError(f"outline {path}: viewBox={text!r} is no view; give it a width and height")
    return x, y, width, height


def _view(place: Size, size: Size, box: Box, element: Element) -> str:
    """The transform from the coordinates of a view to those around it."""
    import svgelements

    aspect = " ".join(element.get("preserveAspectRatio", "xMidYMid").split())
    return str(svgelements.Viewbox.viewbox_transform(*place, *size, *box, aspect))


def _name(element: Element) -> str:
    """The name of an element without its namespace."""
    return str(element.tag).rpartition("}")[2]


class _Plain:
    """A copy of a drawing with copies of elements in place of references to them."""

    def __init__(self, path: Path, root: Element) -> None:
        self._path = path
        self._ids = {e.get("id"): e for e in root.iter() if e.get("id")}
        self._count = 0
        self._space = str(root.tag).rpartition("}")[0]
        self.copy = Element("svg")
        for style in (e for e in root.iter() if _name(e) == "style"):  # each is about all
            SubElement(self.copy, "style").text = _IMPORTANT.sub("", "".join(style.itertext()))
        for name in set(root.keys()) - _FRAME:
            self.copy.set(name, root.get(name, ""))
        self._settle(self.copy, None)
        box = _box(path, root)
        whole = box[2:] if box else tuple(_units(root.get(side)) for side in _SIDES)
        self._inside(self.copy, root, whole, ())

    def _inside(self, new: Element, of: Element, size: Whole, above: Above) -> None:
        """Copy the visible children of an element, but for those of other languages."""
        for child in of:
            ours = str(child.tag).rpartition("}")[0] == self._space
            if ours and _name(child) not in _UNSEEN:
                self._add(new, child, size, above)

    def _add(
        self, parent: Element, element: Element, size: Whole, above: Above, asked: Sides = _NO_SIDES
    ) -> None:
        """Copy an element into a view of a size; a reference may have asked for its sides."""
        numbers = _NUMBER.findall(element.get("d", "") + " " + element.get("points", ""))
        # no segment has more than seven numbers
        self._count += 1 + len(numbers) // 7
        remedy = "simplify paths, or let fewer <use> elements refer to each other"
        check_count(f"outline {self._path}", self._count, "curves", remedy, most=MOST_CURVES)
        name = _name(element)
        new = SubElement(parent, name, element.attrib)
        self._settle(new, size)
        if name in ("svg", "symbol"):
            size = self._frame(new, size, asked)
        if name == "use":
            target = self._target(new, above)
            asked = {side: new.attrib.pop(side) for side in _SIDES if side in new.attrib}
            if target is not None:
                self._add(new, target, size, (*above, target), asked)
        else:
            self._inside(new, element, size, above)

    def _settle(self, new: Element, size: Whole | None) -> None:
        """Write lengths in per cent as numbers, and styles as the library reads them."""
        if "style" in new.keys():
            new.set("style", _IMPORTANT.sub("", new.get("style", "")))
        width, height = size or (None, None)
        for name, value in new.items() if size else ():
            if value.strip().endswith("%") and name in _ALONG:
                if width is None or height is None:
                    raise ValueError(
                        f"outline {self._path}: {name}={value!r} of a page of unknown size; give "
                        "the page a viewBox"
                    )
                whole = (width, height, math.hypot(width, height) / math.sqrt(2.0))[_ALONG[name]]
                new.set(name, repr(_units(value, whole)))

    def _frame(self, new: Element, size: Whole, asked: Sides) -> Whole:
        """Make a view within the view a group; the size of the view is given back."""
        given = [asked.get(side, new.get(side, "100%")) for side in _SIDES]
        sides = [_units(text, whole) for text, whole in zip(given, size, strict=True)]
        x, y = (_units(new.get(name, "0")) or 0.0 for name in ("x", "y"))
        box = _box(self._path, new)
        move = f"translate({x!r}, {y!r})"
        if box is not None:
            width, height = (s if s is not None else b for s, b in zip(sides, box[2:], strict=True))
            move = _view((x, y), (width, height), box, new)
        new.set("transform", f"{new.get('transform', '')} {move}")
        new.tag = "g"
        for name in _FRAME & set(new.keys()):
            del new.attrib[name]
        return box[2:] if box is not None else (sides[0], sides[1])

    def _target(self, use: Element, above: Above) -> Element | None:
        """The element to which a <use> refers; the reference is taken off."""
        given = [use.attrib.pop(name) for name in _REFERENCES if name in use.keys()]
        if not given:
            return None
        where = given[0].strip()
        target = self._ids.get(where[1:]) if where.startswith("#") else None
        if target is None:
            raise ValueError(
                f"outline {self._path}: a <use> refers to {where!r}, which is not in the file; "
                "embed it, or delete the reference"
            )
        if target in above:
            raise ValueError(
                f"outline {self._path}: the <use> of {where!r} refers to itself; delete it"
            )
        return target


def _shapes(path: Path, group: Any, names: frozenset[str]) -> Iterator[tuple[Any, frozenset[str]]]:
    """The visible shapes of a group, with the ids and labels of themselves and groups around."""
    import svgelements

    for element in group:
        values = getattr(element, "values", {})
        for clip in ("clip-path", "mask"):
            if str(values.get("attributes", values).get(clip, "none")).strip() != "none":
                raise ValueError(
                    f"outline {path}: {element.id or 'a shape'!r} is seen through a {clip}, which "
                    "is not applied here; trim the curves instead, and release it"
                )
        labels = (value for key, value in values.items() if str(key).endswith("label"))
        inner = names | {str(name) for name in (element.id, *labels) if name}
        if isinstance(element, svgelements.Group | svgelements.Use):
            yield from _shapes(path, element, inner)
        elif isinstance(element, svgelements.Shape):
            # inherited; other than with display, an inner element can be visible again
            if str(values.get("visibility", "")).strip().lower() not in ("hidden", "collapse"):
                yield element, inner


def _of_path(path: Any, placed: Array, moved: Array) -> Iterator[Curve]:
    """The curves of a path, at positions placed @ (x, y) + moved [m]."""
    import svgelements

    def at(point: Any) -> Array:
        return placed @ [float(point.x), float(point.y)] + moved

    square = placed.T @ placed
    alike = np.allclose(square, square[0, 0] * np.eye(2), rtol=_ROUND, atol=_ROUND * square[0, 0])
    side = float(np.sign(np.linalg.det(placed)))
    for segment in path:
        if isinstance(segment, svgelements.Move) or segment.start is None:
            continue
        a, b = at(segment.start), at(segment.end)
        if isinstance(segment, svgelements.Line | svgelements.Close):
            if not np.array_equal(a, b):
                yield Line(a, b)
        elif isinstance(segment, svgelements.Arc):
            rx, ry = float(segment.rx), float(segment.ry)
            if alike and abs(rx - ry) <= _ROUND * rx:
                yield Arc(a, b, at(segment.center), side * float(segment.sweep))
            else:
                middle = map(at, map(segment.point, np.linspace(0.0, 1.0, _POINTS)[1:-1]))
                yield Spline.through(np.array([a, *middle, b]))
        else:  # a Bezier curve of degree 2 or 3
            names = ["control"] if hasattr(segment, "control") else ["control1", "control2"]
            control = np.array([a, *(at(getattr(segment, name)) for name in names), b])
            yield Spline(np.repeat([0.0, 1.0], len(control)), control, len(control) - 1)
