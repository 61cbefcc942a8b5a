# SPDX-License-Identifier: MIT
"""Results folders without a computation: a record with known numbers, and files beside it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image


def record() -> dict[str, Any]:
    """What `run_record` writes, of a made-up run."""
    upper = {"kind": "at most"}
    return {
        "title": "Rod <no. 7> & slider",
        "psi": 3.0e-5,
        "reason": "iterations",
        "residual": 0.02,
        "iterations": 3,
        "feasible": False,
        "violations": {"volume of rod": 0.02},
        "volume": {"rod": 0.51},
        "gray": 0.08,
        "modes": {"rod": 8},
        "mode_error": 1.5e-3,
        "objective": {"name": "IntegralCompliance", "unit": "J s"},
        "bound": {
            "psi": 2.45e-5,
            "full": 6.0e-5,
            "sheet": 2.5e-5,
            "gap": 0.35,
            "text": "no part has less than 0.408 of the full rod's psi",
        },
        "load_cases": {},
        "references": {"full rod": 6.0e-5, "strip": 9.0e-5},
        "constraints": {
            "volume of rod": {"value": 0.51, "bound": 0.5, "unit": "", **upper, "violation": 0.02},
            "Mass": {"value": 0.6, "bound": 0.7, "unit": "kg", **upper, "violation": 0.0},
        },
        "frequencies": {"rod": [812.345, 10444.7]},
        "stress": {"rod": {"value": 2.5e6, "time": 1.1, "position": [0.1, 0.02]}},
        "scene": {
            "text": "22 coordinates, 3 constraints; psi = 3e-05",
            "modes_error": 1.3e-3,
            "step_error": 2.0e-4,
            "coordinates": 22,
            "rows": 3,
            "left_out": ["gravity", "damping"],
            "bodies": {
                "rod": {
                    "kind": "flexible",
                    "constraint_modes": 3,
                    "normal_modes": 8,
                    "highest_frequency": 5000.0,
                    "next_frequency": None,
                    "softening": 9e-6,
                    "elements": 4000,
                    "order": 1,
                    "material": {"kind": "PlaneStress", "young": 2.1e11, "thickness": 0.01},
                }
            },
            "joints": [{"name": "crank pin", "kind": "Revolute", "between": ["rod.left", "pin"]}],
            "loads": ["point mass 0.5 kg at rod.right"],
            "integrator": "GeneralizedAlpha",
            "duration": 2.0,
            "steps": 2000,
            "order": 2,
        },
        "parts": {
            "rod": {
                "area": 0.012,
                "thickness": 0.01,
                "mass": 0.942,
                "center": [0.2, 1e-12],
                "bounds": [0.0, -0.02, 0.4, 0.02],
                "thinnest_member": {"value": 0.01, "ends": [[0.2, 0.01], [0.2, 0.02]]},
                "narrowest_gap": {"value": 0.02, "ends": [[0.25, -0.01], [0.25, 0.01]]},
                "pieces": 1,
                "holes": 1,
                "loose": 0,
            }
        },
        "verification": {
            "reported": 3.0e-5,
            "part": 3.3e-5,
            "difference": 0.1,
            "change": 1.3e-3,
            "tolerance": 2e-3,
            "converged": True,
            "meshes": [{"size": 5e-3, "psi": 3.25e-5}, {"size": 2.5e-3, "psi": 3.3e-5}],
            "constraints": {"Mass": [0.6, 0.65]},
            "bodies": {
                "rod": {
                    "cells": 12345,
                    "modes": 8,
                    "mass": [0.6, 0.65],
                    "volume": [0.51, 0.52],
                    "stress": [2.5e6, 5e6],
                    "frequencies": [[800.0], [700.0]],
                }
            },
        },
        "warnings": [{"category": "DesignWarning", "message": "12 % of 'rod' is gray"}],
        "versions": {"dolfinx_ffr": "0.1.0", "DOLFINx": "0.5.2"},
        "command": "python demos/slider_crank.py --elements 80 8",
        "date": "2026-03-04T05:06:07+00:00",
        "ranks": 2,
        "seconds": 23.4,
        "level_set_knots": 729,
    }


def write_run(folder: Path, summary: dict[str, Any] | None, *, history: bool = True) -> Path:
    """Make a results folder with a summary.json, where one is given, and a history.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    if summary is not None:
        (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    if history:
        rows = ["iteration,psi,volume,gray,sharpness,modes,mode_error,frequency,step,accepted"]
        rows += [
            f"{k},{6e-5 / (k + 1)},0.5,{0.9 - 0.2 * k},{2**k},8,nan,800,0.1,1" for k in range(4)
        ]
        (folder / "history.csv").write_text("\n".join(rows) + "\n")
    sizes = {"scene": (60, 90), "design": (20, 80), "part": (30, 80), "own_thing": (9, 9)}
    for name, size in sizes.items():
        Image.fromarray(np.full((*size, 3), 200, np.uint8)).save(folder / f"{name}.png")
    frames = [Image.new("RGB", (40, 30), color) for color in ("red", "blue")]
    frames[0].save(folder / "motion.gif", save_all=True, append_images=frames[1:], duration=100)
    return folder
