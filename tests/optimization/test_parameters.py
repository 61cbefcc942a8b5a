# SPDX-License-Identifier: MIT
"""Parameters of a mechanism through `Problem` and `optimize`, beside bodies and alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from shared.problems import slider_crank

import dolfinx_ffr as ffr
from dolfinx_ffr.objective import DrivePower
from dolfinx_ffr.verification import taylor_test

#: Coarse steps and gray designs are no matter here.
pytestmark = [
    pytest.mark.filterwarnings(f"ignore::dolfinx_ffr.{name}Warning")
    for name in ("TimeStep", "Design", "LargeDeformation")
]

END, PIN = ("arm", "end"), ("arm", "pin")
MARKERS = {"pin": (-0.3, 0.0), "end": (0.2, 0.0)}
PARAMETERS = ffr.Parameters(
    stiffness=(40.0, 10.0, 200.0, "N/m", "log"),
    mass=(0.3, 0.1, 0.5, "kg"),
    anchor=(0.7, 0.5, 0.9, "m"),
)


def arm(stiffness: float, mass: float, anchor: float) -> tuple[ffr.Mechanism, dict[str, Any]]:
    """A rigid arm that a motor lifts, with a spring; its own mass is the parameter."""
    spring = ffr.SpringDamper(END, ffr.Ground((0.0, anchor)), stiffness, length=0.1)
    angle = ffr.PrescribedAngle(PIN, ffr.Motion.smooth_step(1.0, 0.5), name="motor")
    joints = [ffr.Revolute(PIN, ffr.Ground()), angle]
    body = ffr.VolumeIntegrals.rigid(mass, (0.02, 0.01), 0.05, MARKERS)
    placed = {"arm": ffr.Placement((0.3, 0.0))}
    mechanism = ffr.Mechanism(placed, joints, gravity=(0.0, -9.81), forces=[spring])
    return mechanism, {"arm": body}


def arm_problem(build: Any = arm, parameters: ffr.Parameters = PARAMETERS) -> ffr.Problem:
    times, power = ffr.GeneralizedAlpha(0.5, 30), ffr.Constraint(DrivePower("motor"), upper=6.0)
    mechanism = parameters.mechanism(build)
    return ffr.Problem({}, mechanism, times, ffr.JointForce("motor"), [power])


CRANK = ffr.Parameters(
    radius=(0.1, 0.08, 0.12, "m"),
    stiffness=(500.0, 100.0, 5000.0, "N/m", "log"),
    load=(0.5, 0.2, 1.0, "kg"),
    anchor=(0.6, 0.5, 0.7, "m"),
    slope=(0.1, 0.0, 0.2),
    turns=(6.0, 5.0, 7.0, "rad"),
)


def crank(
    radius: float, stiffness: float, load: float, anchor: float, slope: float, turns: float
) -> ffr.Mechanism:
    """The flexible rod of a slider-crank on a slope, with a spring at its slider."""
    moving = ffr.Moving.circle((0, 0), radius, ffr.Motion.smooth_step(turns, 0.5))
    slider = ("rod", "right")
    return ffr.Mechanism(
        placements={"rod": ffr.Placement((radius, 0.0))},
        joints=[
            ffr.Revolute(("rod", "left"), moving, name="motor"),
            ffr.PointOnLine(slider, ffr.Ground(), (1.0, slope)),
        ],
        point_masses=[ffr.PointMass(slider, load)],
        forces=[ffr.SpringDamper(slider, ffr.Ground((anchor, 0.2)), stiffness, length=0.2)],
    )


def crank_problem(comm: MPI.Comm, integrator: Any = None) -> ffr.Problem:
    bodies = {"rod": slider_crank(comm, (20, 4), modes=2).flexible["rod"]}
    bounds = [
        ffr.Constraint(DrivePower("motor"), upper=9.0),
        ffr.Constraint(ffr.JointForce("motor", power=8.0), upper=300.0, name="force"),
    ]
    integrator = integrator or ffr.GeneralizedAlpha(0.5, 60)
    return ffr.Problem(bodies, CRANK.mechanism(crank), integrator, ffr.IntegralCompliance(), bounds)


HUNG = ffr.Parameters(
    stiffness=(900.0, 500.0, 5000.0, "N/m", "log"),
    anchor=(0.1, 0.05, 0.2, "m"),
    slope=(0.2, 0.1, 0.3),
    side=(2.0, 1.0, 3.0, "m/s^2"),
    push=(5.0, 2.0, 9.0, "N"),
    height=(0.01, 0.0, 0.02, "m"),
)


def hung(start: ffr.mechanism.Start, **p: float) -> ffr.Mechanism:
    """A rod in space on a skew hinge and a spring, pushed, placed beside its hinge."""
    tip, skew = ("rod", "right"), (0.0, 1.0, p["slope"])
    hinge = ffr.Revolute(("rod", "left"), ffr.Ground((0.0, 0.0, p["height"])), "hinge", axis=skew)
    spring = ffr.SpringDamper(tip, ffr.Ground((0.4, p["anchor"], 0.4)), p["stiffness"], 5.0, 0.35)
    push = ffr.Force(tip, lambda t: 0.0, lambda t: p["push"] * np.sin(20.0 * t), z=1.0)
    return ffr.Mechanism(
        {"rod": ffr.Placement((0.0, 0.0, 0.0))},
        [hinge],
        gravity=(0.0, p["side"], -9.81),
        forces=[spring, push],
        start=start,
    )


def hung_problem(comm: MPI.Comm, integrator: Any, start: ffr.mechanism.Start) -> ffr.Problem:
    rod = ffr.Domain.box(comm, 0.4, 0.04, 0.03, elements=(6, 2, 2))
    frame = ffr.ChordFrame("left", "right")
    body = ffr.FlexibleBody(rod, ffr.Isotropic(2e9, 0.3, 2000.0), frame=frame, modes=1)
    mechanism = HUNG.mechanism(lambda **p: hung(start, **p))
    bound = ffr.Constraint(ffr.JointForce("hinge", power=4.0), upper=50.0)
    return ffr.Problem({"rod": body}, mechanism, integrator, ffr.IntegralCompliance(), [bound])


#: In the plane and in space, from assembled and static starts, with both integrators; all others
#: are those of the tests of `parameter_slopes`
SCENES = {
    "plane alpha": lambda comm: crank_problem(comm, ffr.GeneralizedAlpha(0.5, 60)),
    "space static radau": lambda c: hung_problem(
        c, ffr.RadauIIA(0.2, steps=12), ffr.StaticEquilibrium()
    ),
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=list(SCENES))
def test_derivatives_beside_densities(comm: MPI.Comm, scene: Any) -> None:
    """By each parameter as by differences; by all and densities together the Taylor test."""
    problem = scene(comm)
    domain, given = problem.flexible["rod"].domain, problem.parameters
    x = 0.5 + 0.2 * np.sin(40.0 * domain.centroids[:, 0])

    def numbers(values: np.ndarray, densities: np.ndarray = x) -> np.ndarray:
        computed = problem.value({"rod": densities, "machine": values})
        return np.array([computed.psi, *(c.violation for c in computed.constraints.values())])

    here, at = problem.gradient({"rod": x, "machine": given.array}), given.array
    assert here.gradient is not None
    np.testing.assert_array_equal(here.gradient["machine"], list(here.parameters.values()))
    for k, (name, low, high) in enumerate(given.ranges):
        h = 3e-4 * (low + high) * np.eye(len(at))[k]
        near, far = (numbers(at + s * h) - numbers(at - s * h) for s in (1.0, 2.0))
        by = [here.parameters[name], *(c.parameters[name] for c in here.constraints.values())]
        np.testing.assert_allclose(by, (8.0 * near - far) / (12.0 * h[k]), rtol=1e-7)
    widths = np.array([low + high for _, low, high in given.ranges])
    along, shift = 0.3 * np.cos(90.0 * domain.centroids[:, 0]), 0.3 * widths
    slope = domain.sum(here.gradient["rod"] * along) + here.gradient["machine"] @ shift
    result = taylor_test(
        lambda s: float(numbers(at + s[0] * shift, x + s[0] * along)[0]),
        lambda _: slope,
        np.zeros(1),
        np.ones(1),
    )
    assert result.order == pytest.approx(2.0, abs=0.1), result


@pytest.mark.mpi
def test_parameters_and_a_body_on_several_ranks(comm: MPI.Comm, shared_tmp_path: Path) -> None:
    """Together they come lower than the body alone; history and summary tell the parameters."""
    folder = shared_tmp_path
    problem = crank_problem(comm)
    level = ffr.DensityDesign(problem.flexible["rod"].domain)
    run: dict[str, Any] = {"iterations": 3, "progress": False, "boundary": 0, "volume": 0.6}
    run["mode_tolerance"] = None
    alone = ffr.optimize(problem, level, **run)
    together = {"rod": level, "machine": CRANK}
    result = ffr.optimize(problem, together, output=folder, **run)
    assert result.psi < 0.9 * alone.psi and not alone.parameters
    radius = result.history["parameter radius [m]"]
    assert radius[0] == 0.1 and result.parameters["radius"] == pytest.approx(radius[-1], rel=1e-12)
    reported = result.summary()["parameters"]["stiffness"]
    assert reported["unit"] == "N/m" and reported["start"] == pytest.approx(500.0)
    assert result.problem.parameters == CRANK.at(result.parameters)
    assert result.problem.value(result.densities["rod"]).psi == pytest.approx(result.psi, rel=1e-9)
    run["iterations"] = 4
    again = ffr.optimize(problem, together, output=folder, resume=True, **run)
    np.testing.assert_array_equal(again.history["psi"][:4], result.history["psi"])


def test_parameters_alone() -> None:
    """Without a mesh; what stands at a bound is told."""
    problem = arm_problem()
    result = ffr.optimize(problem, PARAMETERS, iterations=15, progress=False)
    assert result.psi < 0.2 * result.history["psi"][0] and result.feasible
    assert result.at_bounds == {"parameters": {"stiffness": "lower", "anchor": "lower"}}
    other = problem.at({"mass": 0.4})
    assert other.parameters == PARAMETERS.at({"mass": 0.4})
    assert other.value({}).psi == problem.value([40.0, 0.4, 0.7]).psi != problem.value({}).psi
    cases = {
        name: ffr.MechanicalProblem(PARAMETERS.mechanism(arm), part.integrator, part.objective)
        for name in ("one", "two")
        for part in problem.load_cases.values()
    }
    both = ffr.Problem.of_load_cases({}, cases).gradient({})
    single = problem.gradient({})
    for name, slope in both.parameters.items():
        assert slope == pytest.approx(2.0 * single.parameters[name], rel=1e-12)


def test_a_trial_without_a_mechanism_is_taken_back() -> None:
    def build(stiffness: float, mass: float, anchor: float) -> Any:
        if mass > 0.4:
            raise ValueError("too heavy")
        return arm(stiffness, mass, anchor if mass < 0.36 else np.nan)

    result = ffr.optimize(arm_problem(build), PARAMETERS, iterations=12, progress=False)
    assert not result.history["accepted"].all()
    assert 0.3 < result.parameters["mass"] < 0.36 and result.psi < result.history["psi"][0]
    with pytest.raises(ffr.SimulationError, match=r"no mechanism with .*mass = 0.45.*too heavy"):
        arm_problem(build).value([40.0, 0.45, 0.7])


def other_forces(stiffness: float, mass: float, anchor: float) -> Any:
    mechanism, bodies = arm(stiffness, mass, anchor)
    return (
        (ffr.Mechanism(mechanism.placements, mechanism.joints), bodies)
        if mass > 0.4
        else (
            mechanism,
            bodies,
        )
    )


def refusals() -> dict[str, Any]:
    good, own = arm_problem(), ffr.Parameters(idle=(1.0, 0.0, 2.0), **PARAMETERS.entries)
    idle = arm_problem(lambda idle, **others: arm(**others), own)
    return {
        "nothing depends on 'idle'": lambda: ffr.optimize(idle, own),
        "the forces of a mechanism must": lambda: ffr.optimize(
            arm_problem(other_forces), PARAMETERS
        ),
        "the function takes 'height', and the parameters": lambda: arm_problem(
            lambda height, **others: arm(**others)
        ),
        "no mechanism with stiffness = 40": lambda: arm_problem(
            lambda **all: arm(**{**all, "stiffness": np.nan})
        ),
        r"parameter 'p' must be \(value, lower, upper\)": lambda: ffr.Parameters(p=3.0),
        "parameter 'p' must lie between 0 and 1": lambda: ffr.Parameters(p=(-1.0, 0.0, 1.0)),
        "lower bound of parameter 'p' must be positive": lambda: ffr.Parameters(
            p=(1.0, 0.0, 2.0, "", "log")
        ),
        "'mas'": lambda: good.at({"mas": 0.2}),
        "parameter 'mass' must lie": lambda: good.at({"mass": 0.7}),
        "or other bounds": lambda: ffr.optimize(good, own),
        "give the parameters once, and not by the name of a body, 'arm'": lambda: ffr.optimize(
            good, {"arm": PARAMETERS}
        ),
        "different parameters": lambda: ffr.Problem.of_load_cases(
            {},
            {
                "one": good.load_cases["load case"],
                "two": good.at({"mass": 0.2}).load_cases["load case"],
            },
        ),
    }


@pytest.mark.parametrize("message", list(refusals()))
def test_refused(message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message):
        refusals()[message]()


def test_parameters_without_a_design_are_named() -> None:
    problem = crank_problem(MPI.COMM_SELF)
    design = ffr.DensityDesign(problem.flexible["rod"].domain)
    with pytest.warns(ffr.DesignWarning, match=r"parameters \['radius'.* keep their values"):
        result = ffr.optimize(problem, design, iterations=0, boundary=0, progress=False)
    assert result.problem.parameters == CRANK
