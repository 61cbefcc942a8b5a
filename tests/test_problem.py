# SPDX-License-Identifier: MIT
"""The whole chain from densities to the objective and back."""

from __future__ import annotations

from dataclasses import replace

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from slider_crank import reference_problem, simple_designs

import dolfinx_ffr as ffr
from dolfinx_ffr.verification import (
    assert_taylor_order,
    central_difference,
    convergence_order,
    taylor_test,
)

#: psi of the reference scene's full rod [J s], from the same code on any supported release
PSI_FULL_ROD = 5.831832625800e-05


def designs(problem: ffr.Problem) -> dict[str, np.ndarray]:
    """Densities of very different kinds, functions of position alone."""
    domain = problem.flexible["rod"].domain
    c = domain.centroids
    # as good as random, but the same on any number of ranks
    noise = np.modf(43758.5453 * np.sin(12.9898e2 * c[:, 0] + 78.233e2 * c[:, 1]))[0]
    # so steep that elements inside the hole are void to the last digit
    levelset = ffr.LevelSet(domain).with_sharpness(400.0)
    hole = levelset.from_distance(
        lambda x: 0.03 * (np.hypot((x[:, 0] - 0.2) / 0.12, x[:, 1] / 0.014) - 1.0)
    )
    return {
        "random": 0.55 + 0.4 * noise,
        "solid": np.ones(domain.n_cells),
        "level set": levelset.density(hole),
    }


@pytest.mark.slow
@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["random", "solid", "level set"])
@pytest.mark.parametrize(
    ("cell", "order"), [("quadrilateral", 1), ("quadrilateral", 2), ("triangle", 2)]
)
def test_gradient_of_the_whole_chain(comm: MPI.Intracomm, cell: str, order: int, kind: str) -> None:
    """Taylor order 2 and agreement with central differences, with elements at the floor too."""
    elements = (20, 4) if order == 2 else (40, 8)
    problem = reference_problem(comm, elements, cell=cell, order=order, modes=6, steps=300)
    domain = problem.flexible["rod"].domain
    density = designs(problem)[kind]
    c = domain.centroids
    direction = np.cos(300 * c[:, 0] + 900 * c[:, 1] + 1.0)
    if kind != "random":  # stay within [0, 1]
        inwards = np.where(density > 0.5, -1.0, 1.0)
        direction = inwards * np.abs(direction)
        density = np.clip(density, 0.0, 1.0)
    evaluation = problem.gradient(density)
    assert evaluation.gradient is not None
    gradient = evaluation.gradient["rod"]

    def value(x: np.ndarray) -> float:
        return problem.value(x).psi

    def slope(d: np.ndarray) -> float:
        return comm.allreduce(float(gradient @ d))

    # short: at the floor the stiffness grows with the cube of the step
    steps = [5e-4 / 2**k for k in range(4)]
    assert_taylor_order(taylor_test(value, slope, density, direction, steps=steps, roundoff=1e-12))
    if kind == "random":
        difference = central_difference(value, density, direction, 1e-3)
        assert slope(direction) == pytest.approx(difference, rel=1e-6)
    if kind == "level set":
        share = domain.sum(domain.cell_volumes * (density < 1e-12)) / domain.area
        assert share > 0.05


@pytest.mark.mpi
def test_gradient_with_a_marker_inside(comm: MPI.Intracomm) -> None:
    """A joint in the middle of the rod: its shape functions depend on the density."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(32, 4))
    rod = ffr.FlexibleBody(
        domain,
        ffr.PlaneStress(2e9, 0.3, 1000.0, 0.01),
        frame=ffr.ChordFrame("left", "right"),
        modes=4,
        markers={"middle": (0.2, 0.003), "tip": (0.3, 0.02)},
    )
    angle = ffr.Motion.smooth_step(2.0, 0.2)
    mechanism = ffr.Mechanism(
        placements={"rod": ffr.Placement(position=(0.0, 0.0))},
        joints=[
            ffr.Revolute(("rod", "middle"), ffr.Ground((0.2, 0.003))),
            ffr.PrescribedAngle(("rod", "middle"), angle),
        ],
        point_masses=[ffr.PointMass(("rod", "tip"), 0.05)],
        gravity=(0.0, -9.81),
        damping={"rod": ffr.RayleighDamping(1.0, 1e-5)},
    )
    problem = ffr.Problem(
        {"rod": rod}, mechanism, ffr.GeneralizedAlpha(0.2, 200), ffr.IntegralCompliance()
    )
    c = domain.centroids
    density = 0.7 + 0.2 * np.sin(50 * c[:, 0] + 90 * c[:, 1])
    direction = np.cos(80 * c[:, 0] + 200 * c[:, 1])
    gradient = problem.gradient(density).gradient
    assert gradient is not None
    slope = comm.allreduce(float(gradient["rod"] @ direction))
    difference = central_difference(lambda x: problem.value(x).psi, density, direction, 2e-3)
    assert slope == pytest.approx(difference, rel=1e-6)


@pytest.mark.mpi
def test_same_numbers_on_any_number_of_ranks(comm: MPI.Intracomm) -> None:
    """Psi to 1e-9 and gradient to 1e-7 as on one rank alone."""
    shared = reference_problem(comm, (40, 8), steps=400)
    alone = reference_problem(MPI.COMM_SELF, (40, 8), steps=400)
    for kind in ("random", "level set"):
        one = alone.gradient(designs(alone)[kind])
        all_ = shared.gradient(designs(shared)[kind])
        assert all_.psi == pytest.approx(one.psi, rel=1e-9)
        found, expected = (e.fixed_interface_frequencies["rod"] for e in (all_, one))
        np.testing.assert_allclose(found, expected, rtol=1e-9)
        assert one.gradient is not None
        assert all_.gradient is not None
        place = {tuple(p): g for p, g in zip(_keys(alone), one.gradient["rod"], strict=True)}
        expected = np.array([place[tuple(p)] for p in _keys(shared)])
        scale = np.linalg.norm(one.gradient["rod"]) / np.sqrt(len(one.gradient["rod"]))
        worst = np.max(np.abs(all_.gradient["rod"] - expected), initial=0.0)
        assert comm.allreduce(worst, MPI.MAX) < 1e-7 * scale


def _keys(problem: ffr.Problem) -> np.ndarray:
    return np.round(problem.flexible["rod"].domain.centroids, 9)


@pytest.mark.mpi
def test_every_rank_computes_the_same_bits(comm: MPI.Intracomm) -> None:
    """The reduced half is replicated: not even round-off differs between ranks."""
    problem = reference_problem(comm, (24, 4), steps=100)
    evaluation = problem.value(np.full(problem.flexible["rod"].domain.n_cells, 0.7))
    state = evaluation.trajectory.y.tobytes()
    assert all(other == state for other in comm.allgather(state))
    assert len(set(comm.allgather(evaluation.psi))) == 1


def test_reference_scene(comm: MPI.Intracomm) -> None:
    """Psi of the full rod is the same on every DOLFINx release, and close to the published one."""
    problem = reference_problem(comm, steps=2000)
    domain = problem.flexible["rod"].domain
    values = {name: problem.value(x).psi for name, x in simple_designs(domain).items()}
    assert values["solid"] == pytest.approx(PSI_FULL_ROD, rel=1e-9)
    # strip and even density beside the full rod
    assert values["strip"] / values["solid"] == pytest.approx(1.69, abs=0.02)
    assert 2.4 < values["even"] / values["solid"] < 2.7


def test_change_of_basis_changes_nothing(comm: MPI.Intracomm) -> None:
    """Psi is a property of the span of the shape functions."""
    problem = reference_problem(comm, (40, 8), steps=500)
    evaluation = problem.value(designs(problem)["random"])
    integrals = evaluation.bodies["rod"].integrals
    r = integrals.modes
    rng = np.random.default_rng(5)
    # well-conditioned relative to the modes' own scales, or round-off would tell the bases apart
    scale = 1.0 / np.sqrt(np.diag(integrals.G)[1:])
    mix = scale[:, None] * scipy.linalg.orth(rng.normal(size=(r, r))) * rng.uniform(1, 3, r)
    full = scipy.linalg.block_diag(1.0, mix)
    mixed = ffr.VolumeIntegrals(
        mass=integrals.mass,
        S=full.T @ integrals.S,
        G=full.T @ integrals.G @ full,
        N=full.T @ integrals.N @ full,
        K=mix.T @ integrals.K @ mix,
        markers={
            name: ffr.BodyMarker(m.position, m.displacement @ mix, m.rotation @ mix)
            for name, m in integrals.markers.items()
        },
    )
    trajectory = ffr.simulate(problem.mechanism, {"rod": mixed}, problem.integrator)
    psi = problem.objective.value(trajectory, {"rod": mixed})
    assert psi == pytest.approx(evaluation.psi, rel=1e-10)


@pytest.mark.slow
def test_frames_agree_to_first_order(comm: MPI.Intracomm) -> None:
    """Tangent and chord frame differ only by the square of the deformation."""
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(32, 4))
    differences = []
    for stiffer in (1.0, 10.0, 100.0):
        psi = []
        for frame in (ffr.ChordFrame("left", "right"), ffr.TangentFrame("left")):
            problem = reference_problem(comm, domain=domain, steps=8000)
            material = ffr.PlaneStress(2e9 * stiffer, 0.3, 7850.0, 0.01)
            problem.flexible["rod"] = problem.bodies["rod"] = ffr.FlexibleBody(
                domain, material, frame=frame, modes=8
            )
            psi.append(problem.value(np.ones(domain.n_cells)).psi)
        differences.append(abs(psi[1] / psi[0] - 1))
    # deformation falls with the stiffness
    assert convergence_order([1.0, 0.1, 0.01], differences) > 0.9
    assert differences[-1] < 1e-4


@pytest.mark.parametrize(("order", "sizes"), [(1, (4, 8, 16, 32)), (2, (2, 4, 8, 16))])
def test_mesh_refinement_of_psi(comm: MPI.Intracomm, order: int, sizes: tuple[int, ...]) -> None:
    """Psi of the full rod converges at least with order two, the limit set by the corners."""
    values = []
    for ny in sizes:
        domain = ffr.Domain.rectangle(
            comm, 0.4, 0.04, elements=(5 * ny, ny), order=order, solid_columns=0
        )
        problem = reference_problem(comm, domain=domain, steps=400)
        values.append(problem.value(np.ones(domain.n_cells)).psi)
    differences = np.abs(np.diff(values))
    fitted = convergence_order(1.0 / np.array(sizes[:-1]), differences)
    assert 1.4 < fitted < (2.2 if order == 1 else 4.2)
    assert differences[-1] / values[-1] < (5e-3 if order == 1 else 5e-4)


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x: x[:-1] if len(x) else x, "density of 'rod': has shape"),
        (lambda x: np.where(np.arange(len(x)) == 0, np.nan, x), "are NaN or infinite"),
        (lambda x: 2 * x, r"leave \[0, 1\]"),
    ],
)
def test_bad_density(comm: MPI.Intracomm, change: object, message: str) -> None:
    """A bad density raises on every rank before any work."""
    problem = reference_problem(comm, (10, 2), modes=2, steps=10)
    x = np.ones(problem.flexible["rod"].domain.n_cells)
    with pytest.raises(ValueError, match=message):
        problem.value(change(x))  # type: ignore[operator]


def test_names_of_densities(comm: MPI.Intracomm) -> None:
    """Densities by name must fit the bodies."""
    problem = reference_problem(comm, (10, 2), modes=2, steps=200)
    x = np.ones(problem.flexible["rod"].domain.n_cells)
    assert problem.value({"rod": x}).psi == problem.value(x).psi
    with pytest.raises(ValueError, match=r"given for \['bar'\].*\['rod'\]"):
        problem.value({"bar": x})


def test_nothing_to_design(comm: MPI.Intracomm) -> None:
    """A problem without a flexible body is refused."""
    problem = reference_problem(comm, (10, 2), modes=2, steps=10)
    rigid = ffr.VolumeIntegrals.rigid(1.0, (0.2, 0.0), 0.01, {"left": (0, 0), "right": (0.4, 0)})
    with pytest.raises(ValueError, match="has a density to design"):
        ffr.Problem({"rod": rigid}, problem.mechanism, problem.integrator, problem.objective)


def test_two_flexible_bodies(comm: MPI.Intracomm) -> None:
    """A double pendulum of two flexible links: one adjoint pass gives both gradients."""
    problem = double_pendulum(soft_link(comm, 16), soft_link(comm, 12))
    x = {
        name: 0.7 + 0.2 * np.sin(60 * body.domain.centroids[:, 0])
        for name, body in problem.flexible.items()
    }
    assert_gradient(problem, x, problem.gradient(x).gradient)


def double_pendulum(upper: ffr.FlexibleBody, lower: ffr.FlexibleBody) -> ffr.Problem:
    """Two links of 0.4 m that fall from the horizontal."""
    mechanism = ffr.Mechanism(
        placements={
            "upper": ffr.Placement(position=(0.0, 0.0)),
            "lower": ffr.Placement(position=(0.4, 0.0)),
        },
        joints=[
            ffr.Revolute(("upper", "left"), ffr.Ground()),
            ffr.Revolute(("lower", "left"), ("upper", "right")),
        ],
        gravity=(0.0, -9.81),
    )
    links = {"upper": upper, "lower": lower}
    return ffr.Problem(links, mechanism, ffr.GeneralizedAlpha(0.3, 300), ffr.IntegralCompliance())


def soft_link(comm: MPI.Intracomm, nx: int = 16) -> ffr.FlexibleBody:
    domain = ffr.Domain.rectangle(comm, 0.4, 0.04, elements=(nx, 4))
    material = ffr.PlaneStress(1e9, 0.3, 1000.0, 0.01)
    return ffr.FlexibleBody(domain, material, frame=ffr.TangentFrame("left"), modes=3)


def assert_gradient(
    problem: ffr.Problem, x: dict[str, np.ndarray], gradient: dict[str, np.ndarray] | None
) -> None:
    """By central differences, body by body."""
    assert gradient is not None
    for name, body in problem.flexible.items():
        domain = body.domain
        direction = np.cos(50 * domain.centroids[:, 0] + 1.0)

        def value(d: np.ndarray, name: str = name) -> float:
            return problem.value({**x, name: d}).psi

        difference = central_difference(value, x[name], direction, 7e-4)
        assert domain.sum(gradient[name] * direction) == pytest.approx(difference, rel=1e-6)


@pytest.mark.mpi
def test_two_designs_in_turn(comm: MPI.Intracomm) -> None:
    """Values first, gradients later and in any order; a body may belong to two problems."""
    problem = reference_problem(comm, (20, 4), modes=3, steps=200)
    body = problem.flexible["rod"]
    slower = ffr.Problem(
        {"rod": body}, problem.mechanism, ffr.GeneralizedAlpha(2.0, 150), ffr.PeakCompliance()
    )
    c = body.domain.centroids
    designs = [{"rod": 0.7 + 0.2 * np.sin(60 * c[:, 0] + phase)} for phase in (0.0, 1.0)]
    evaluations = [(p, x, p.value(x)) for x in designs for p in (problem, slower)]
    for p, x, evaluation in evaluations[::-1]:
        later = p.differentiate(evaluation)
        at_once = p.gradient(x)
        assert later.psi == pytest.approx(at_once.psi, rel=1e-9)
        assert later.gradient is not None and at_once.gradient is not None
        size = np.sqrt(body.domain.sum(at_once.gradient["rod"] ** 2))
        rest = later.gradient["rod"] - at_once.gradient["rod"]
        # one rank has the same modes again, and products whose last bits depend on the memory
        assert np.sqrt(body.domain.sum(rest**2)) <= (1e-8 if comm.size > 1 else 1e-12) * size
    p, x, evaluation = evaluations[0]
    p.value(designs[1])
    assert_gradient(p, x, p.differentiate(evaluation).gradient)


@pytest.mark.mpi
def test_one_body_under_two_names(comm: MPI.Intracomm) -> None:
    """Both links of a double pendulum are one body, each with a density of its own."""
    link = soft_link(comm)
    problem = double_pendulum(link, link)
    c = link.domain.centroids
    x = {
        "upper": 0.7 + 0.2 * np.sin(60 * c[:, 0]),
        "lower": 0.6 + 0.3 * np.cos(40 * c[:, 0]),
    }
    evaluation = problem.gradient(x)
    twins = double_pendulum(soft_link(comm), soft_link(comm)).gradient(x)
    assert evaluation.psi == pytest.approx(twins.psi, rel=1e-9)
    assert_gradient(problem, x, evaluation.gradient)


def test_old_name_of_fixed_interface_frequencies() -> None:
    """It works for one more release, with a warning."""
    problem = reference_problem(MPI.COMM_SELF, (10, 2), steps=300)
    evaluation = problem.value(np.ones(problem.flexible["rod"].domain.n_cells))
    with pytest.warns(DeprecationWarning, match="is now called fixed_interface_frequencies"):
        assert evaluation.frequencies is evaluation.fixed_interface_frequencies


@pytest.mark.mpi
@pytest.mark.parametrize(
    ("objective", "message"),
    [
        (ffr.IntegralCompliance(["bar"]), r"of body 'bar', but the bodies are \['rod', 'disc'\]"),
        (ffr.Mass("bar"), r"mass of body 'bar', but the bodies are \['rod', 'disc'\]"),
        (ffr.Frequency("bar"), r"frequency of body 'bar', but the bodies are \['rod', 'disc'\]"),
        (ffr.PathTracking("rod", "middle", (0.0, 0.0)), r"the markers of body 'rod' are \['left'"),
        (ffr.Mass("rod") + ffr.JointForce("pin"), r"the joints are \['crank pin', 'slider'\]"),
        (ffr.PeakCompliance(["disc"]), r"'disc', which is rigid .* flexible bodies are \['rod'\]"),
        (ffr.IntegralCompliance(weights={"disc": 2.0}), "'disc', which is rigid"),
        (2.0 * ffr.Frequency("disc"), "frequency: body 'disc' is rigid"),
        (ffr.Frequency("rod", 5, cluster=2), "5 elastic coordinates, too few for .* 5 to 6"),
    ],
)
def test_what_does_not_fit_the_bodies_is_refused_before_work(
    comm: MPI.Intracomm, objective: ffr.Objective, message: str
) -> None:
    given = reference_problem(comm, (10, 2), modes=2, steps=10)
    bodies = {**given.bodies, "disc": ffr.VolumeIntegrals.rigid(1.0, (0.0, 0.0), 1e-3, {})}
    placements = {**given.mechanism.placements, "disc": ffr.Placement()}
    mechanism = replace(given.mechanism, placements=placements)
    bound = ffr.Constraint(objective, upper=1.0)
    for psi, bounds in ((objective, []), (ffr.IntegralCompliance(), [bound])):
        with pytest.raises(ValueError, match=message):
            ffr.Problem(bodies, mechanism, given.integrator, psi, bounds)


def test_start_of_a_body_whose_damping_is_stiff(comm: MPI.Comm) -> None:
    """Accelerations that damping ends within a share of a step leave no trace in psi."""
    problem = reference_problem(comm, (20, 4), modes=4, steps=200)
    angle = ffr.Motion.polynomial([0.0, 10.0 * np.pi])
    mechanism = replace(
        problem.mechanism,
        joints=[
            ffr.Revolute(("rod", "left"), ffr.Moving.circle((0.0, 0.0), 0.1, angle)),
            ffr.PointOnLine(("rod", "right"), ffr.Ground()),
        ],
        damping={"rod": ffr.RayleighDamping(beta=1e-4)},
    )

    def psi(steps: int) -> float:
        of = ffr.Problem(
            problem.bodies, mechanism, ffr.GeneralizedAlpha(0.2, steps), problem.objective
        )
        return of.value(np.ones(of.flexible["rod"].domain.n_cells)).psi

    assert psi(200) == pytest.approx(psi(1600), rel=1e-2)
