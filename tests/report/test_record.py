# SPDX-License-Identifier: MIT
"""What a run records for its report: the numbers of result, part and verification as they are."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import slider_crank, three_load_cases

import dolfinx_ffr as ffr
from dolfinx_ffr.report.record import KEYS

COARSE = {"size": 0.014, "tolerance": 0.1, "order": 1, "most": 2}


@pytest.mark.mpi
@pytest.mark.slow
def test_record_of_a_run(
    comm: MPI.Comm, shared_tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = slider_crank(comm, (20, 4), modes=2, steps=200)
    rod = problem.flexible["rod"]
    full = problem.value(np.ones(rod.domain.n_cells))
    design = ffr.DensityDesign(rod.domain)
    with pytest.warns(ffr.DesignWarning), ffr.recorded_warnings() as messages:
        # too few iterations: the sharp design is above its volume
        settings = {"iterations": 1, "progress": False, "mode_tolerance": None}
        result = ffr.optimize(problem, design, volume=0.8, output=shared_tmp_path, **settings)

    def hole(x: np.ndarray) -> np.ndarray:
        return np.hypot(x[:, 0] - 0.2, x[:, 1]) - 0.01

    part = ffr.Part(rod.domain, hole, material=rod.material)
    verification = ffr.verify(problem, {"rod": part}, full, **COARSE)
    references = {"full rod": full.psi, "what holds nothing": float("inf")}
    details = {"verification": verification, "warnings": messages, "references": references}
    record = ffr.run_record(result, title="Rod", parts={"rod": part}, **details)
    assert set(record) == set(KEYS)
    assert comm.allgather(json.dumps(record)) == [json.dumps(record)] * comm.size
    assert record["psi"] == result.psi
    assert record["objective"] == {"name": "IntegralCompliance", "unit": "J s"}
    bound = record["bound"]
    assert bound["text"].startswith("no part of this material within this outline has less than")
    assert bound["gap"] == pytest.approx(verification.psi / bound["psi"] - 1.0)
    assert result.gap == pytest.approx(result.psi / bound["psi"] - 1.0)
    assert record["references"] == {"full rod": full.psi, "what holds nothing": None}
    volume = record["constraints"]["volume of rod"]
    assert volume["bound"] == 0.8
    assert volume["violation"] == result.violations["volume of rod"] > 0.0
    assert record["ranks"] == comm.size
    assert [entry["category"] for entry in record["warnings"]] == ["DesignWarning"]
    drawn = record["parts"]["rod"]
    assert drawn["area"] == pytest.approx(0.4 * 0.04 - np.pi * 0.01**2, rel=1e-5)
    assert drawn["narrowest_gap"]["value"] == pytest.approx(0.02, rel=1e-2)
    assert drawn["mass"] == part.mass
    checked = record["verification"]
    assert checked["part"] == verification.psi
    assert checked["difference"] == pytest.approx(verification.psi / full.psi - 1.0, abs=1e-12)
    assert checked["bodies"]["rod"]["mass"][1] == verification.fitted[-1].bodies["rod"].mass
    scene = record["scene"]
    assert scene["text"] == str(ffr.model_report(result.problem, result.evaluation))
    assert [joint["name"] for joint in scene["joints"]] == ["crank pin", "slider"]
    assert scene["bodies"]["rod"]["material"]["young"] == rod.material.young
    assert {"DOLFINx", "PETSc", "SLEPc", "NumPy", "SciPy", "Python"} < set(record["versions"])

    def fails(*_: object) -> None:
        raise ffr.SimulationError("too long steps", trajectory=None)

    monkeypatch.setattr("dolfinx_ffr.report.record.model_report", fails)
    without = ffr.run_record(result)
    assert "step_error" not in without["scene"]
    assert "too long steps" in without["warnings"][-1]["message"]

    ffr.write_summary(comm, shared_tmp_path / "summary.json", record)
    page = ffr.write_report(comm, shared_tmp_path).read_text(encoding="utf-8")
    assert "Constraints are violated: volume of rod by" in page
    # of all that a record can hold nothing is missing; pictures were not drawn here
    assert "summary.json:" not in page
    assert "scene.png: the mechanism" in page


@pytest.mark.mpi
def test_record_of_other_bodies_is_refused(comm: MPI.Comm) -> None:
    with pytest.raises(TypeError, match=r"result must be what optimize\(\) returned"):
        ffr.run_record(3)  # type: ignore[arg-type]


def test_warnings_are_listed_once_and_shown() -> None:
    with pytest.warns(UserWarning) as caught, ffr.recorded_warnings() as messages:
        for text in ("one", "two", "one"):
            warnings.warn(text, ffr.DesignWarning, stacklevel=1)
    assert [str(warning.message) for warning in caught] == ["one", "two", "one"]
    assert messages == [{"category": "DesignWarning", "message": text} for text in ("one", "two")]
    with pytest.warns(UserWarning):
        warnings.warn("afterwards", UserWarning, stacklevel=1)
    assert len(messages) == 2


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*is gray, neither void nor solid")
def test_record_and_page_of_several_load_cases(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """Each load case has its psi, its part's psi, its joints and loads; constraints name theirs."""
    weights = {"slow": 1.5, "fast": 1.0, "lever": 0.5}
    problem = three_load_cases(comm, ffr.WorstCase(weights))
    rod = problem.flexible["rod"]
    settings = {"iterations": 2, "boundary": 0, "progress": False, "mode_tolerance": None}
    settings["output"] = shared_tmp_path
    design = ffr.DensityDesign(rod.domain)
    result = ffr.optimize(problem, design, optimizer=ffr.MMA(length=40), **settings)
    part = ffr.Part(rod.domain, lambda x: np.ones(len(x)), material=rod.material)
    with pytest.warns(ffr.PartWarning, match="the part violates .*'fast: JointForce' by"):
        # twice as heavy as the design
        verification = ffr.verify(result.problem, {"rod": part}, result.evaluation, **COARSE)
    record = ffr.run_record(result, title="Rod", verification=verification, volume=0.5)
    assert comm.allgather(json.dumps(record)) == [json.dumps(record)] * comm.size
    assert record["objective"] == {"name": "WorstCase", "unit": ""}
    load_cases = record["load_cases"]
    expected = {n: m.psi for n, m in result.evaluation.load_cases.items()}
    assert {n: m["psi"] for n, m in load_cases.items()} == expected
    assert {n: m["weight"] for n, m in load_cases.items()} == weights
    assert load_cases["slow"]["objective"] == {"name": "IntegralCompliance", "unit": "J s"}
    assert (load_cases["fast"]["duration"], load_cases["fast"]["steps"]) == (1.6, 400)
    assert load_cases["lever"]["loads"][0].startswith("point mass 1 kg")
    assert (
        record["verification"]["load_cases"]["fast"][1]
        == verification.fitted[-1].load_cases["fast"]
    )
    assert record["constraints"]["lever: stress"]["unit"] == "Pa"
    assert record["constraints"]["slow: JointForce"]["unit"] == "N"
    assert record["stress"]["rod"]["load_case"] == "lever"
    ffr.write_summary(comm, shared_tmp_path / "summary.json", record)
    page = ffr.write_report(comm, shared_tmp_path).read_text()
    messages = (
        "Reported, weighted | ψ of the design is their worst case | lever: stress | In load case"
    )
    messages += (
        " | Objectives of the load cases over the iterations | point mass 1 kg | by the part"
    )
    for text in messages.split(" | "):
        assert text in page, text
