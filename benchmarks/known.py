# SPDX-License-Identifier: MIT
"""Optima that are known in closed form, and how near a design comes to them."""

import math
import warnings
from collections.abc import Callable
from time import process_time
from typing import Any

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_rectangle
from jobs import Array, Job, Progress, Results
from report import Study, line, plot
from scipy.integrate import cumulative_trapezoid, trapezoid
from scipy.optimize import brentq
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import spsolve
from shapely import LineString, Polygon, box

import dolfinx_ffr as ffr
from dolfinx_ffr.plotting.style import BLUE, ORANGE

YOUNG, DENSITY, THICKNESS = 210e9, 7850.0, 0.01
#: Ratios of the end mass to the mass of a bar
RATIOS = [0.05, 0.25, 1.0]
#: Mean density of the sheet that is a bar, and the least density
MEAN, LEAST = 0.05, 0.002
STILL = ffr.Motion.constant(0.0)


def known_jobs(*, quick: bool) -> list[Job]:
    """The measurements: one process for each optimum."""
    jobs = [Job("known", "pulled_bar", 6.0, {"ratio": ratio}) for ratio in RATIOS]
    jobs += [Job("known", "spinning_bar", 6.0, {"ratio": ratio}) for ratio in RATIOS]
    jobs += [Job("known", "spinning_arm", 10.0, {"chi": chi}) for chi in (0.25, 0.5, 0.75)]
    jobs.append(Job("known", "spinning_arm", 10.0, {"chi": 0.75, "least": "stress"}))
    jobs += [Job("known", name, 10.0) for name in ("rod", "cantilever", "two_bars", "drive")]
    jobs += [Job("known", "four_bar", 10.0, {"by": by}) for by in ("counterweights", "springs")]
    jobs.append(Job("known", "vibrating_beam", 20.0))
    jobs.append(Job("known", "mosaic", 1.0))
    return [jobs[0], jobs[-3], jobs[-1]] if quick else jobs


class Sheet(ffr.DensityDesign):
    """A sheet of variable thickness: densities are the variables, and become no sharper."""

    class Identity:
        """From a variable in [0, 1] to a density in [LEAST, 1]."""

        beta, eta = 1.0, 0.5

        def __call__(self, variables: Array) -> Array:
            return LEAST + (1.0 - LEAST) * variables

        def pullback(self, variables: Array, bar: Array) -> Array:
            return (1.0 - LEAST) * bar

    def __init__(self, domain: ffr.Domain) -> None:
        super().__init__(domain, radius=0.0)
        self.projection = self.Identity()  # type: ignore[assignment]

    def at(self, progress: float) -> "Sheet":
        return self


def optimised(
    problem: ffr.Problem, design: Any, scale: Callable[[ffr.Result], float], **options: Any
) -> dict[str, Any]:
    """The end of a run: the result by a ``scale`` in which one is the known optimum."""
    began = process_time()
    with warnings.catch_warnings():
        # bars as thin as these are neither parts nor solids for the warnings that look for these
        warnings.simplefilter("ignore")
        result = ffr.optimize(problem, design, progress=False, boundary=0, **options)
    found = result.evaluation
    excess = [bound.violation for bound in found.constraints.values()]
    excess += [found.volume[name] / most - 1.0 for name, most in result.bounds.items()]
    row = {"ours": scale(result), "iterations": result.iterations}
    row |= {"excess": max(excess, default=0.0), "seconds": process_time() - began}
    return {"frozen": math.nan, "above": 100.0 * (row["ours"] - 1.0), **row}


# %% Bars whose area is designed
def _bar(ratio: float, spin: float) -> tuple[ffr.Problem, Sheet, float]:
    """A bar with an end mass, under gravity along its axis or spinning; and its mass [kg]."""
    domain = ffr.Domain.rectangle(MPI.COMM_SELF, 1.0, 0.05, elements=(60, 2), solid_columns=0)
    law = ffr.SIMP(exponent=1.0, floor=1e-9, mass=ffr.LinearMass())
    steel = ffr.PlaneStress(YOUNG, 0.0, DENSITY, THICKNESS)
    frame = ffr.TangentFrame("left")
    body = ffr.FlexibleBody(domain, steel, frame=frame, modes=24, interpolation=law)
    mass = DENSITY * THICKNESS * 0.05 * MEAN
    hub = ffr.Moving(STILL, STILL, ffr.Motion.polynomial([0.0, spin])) if spin else ffr.Ground()
    mechanism = ffr.Mechanism(
        placements={"bar": ffr.Placement(angular_velocity=spin)},
        joints=[ffr.Weld(("bar", "left"), hub)],
        point_masses=[ffr.PointMass(("bar", "right"), ratio * mass)],
        gravity=(0.0 if spin else 9.81, 0.0),
        start=ffr.Assembled() if spin else ffr.StaticEquilibrium(),
    )
    # of the spinning bar long steps leave the steady state alone
    method = ffr.RadauIIA(1.0, steps=3) if spin else ffr.GeneralizedAlpha(1.0, 10)
    problem = ffr.Problem({"bar": body}, mechanism, method, ffr.IntegralCompliance())
    return problem, Sheet(domain), mass


def _designed_bar(ratio: float, spin: float, optimum: float, frozen: float) -> dict[str, Any]:
    problem, sheet, _ = _bar(ratio, spin)
    even = np.full(sheet.size, (MEAN - LEAST) / (1.0 - LEAST))
    options = {"start": even, "volume": MEAN, "iterations": 60}
    row = optimised(problem, sheet, lambda result: result.psi / optimum, **options)
    return {**row, "frozen": frozen}


def pulled_bar(comm: MPI.Comm, progress: Progress, *, ratio: float) -> dict[str, Any]:
    """Least compliance of a bar under its own weight and that of an end mass.

    The end mass is ``ratio`` times the mass m of the bar; s runs from 0 at the support to 1. psi is
    the largest value of 2 f u - E A u'^2 over all displacements, so its derivative by the area at s
    is 2 rho g u - E u'^2, which is minus the multiplier of the mean. Therefore the strain u' is
    linear in s, and with the force at the end it is rho g L (ratio + s) / E. The equilibrium of the
    force E A u' gives the area ratio (1 + ratio) / (ratio + s)^2 of its mean A, and psi =
    (m g)^2 L / (E A) ratio (1 + ratio). Densities are both load and strength: psi is monotone in
    none of them.
    """
    force = DENSITY * THICKNESS * 0.05 * MEAN * 9.81
    unit = force**2 / (YOUNG * THICKNESS * 0.05 * MEAN)
    # frozen loads are followed by the same stress everywhere: area and force fall exponentially
    frozen = 1.0 / math.log1p(1.0 / ratio) ** 2 / (ratio * (1.0 + ratio))
    row = _designed_bar(ratio, 0.0, unit * ratio * (1.0 + ratio), frozen)
    return {"case_text": f"pulled bar, end mass {ratio:g}", "ratio": ratio, **row}


def spinning_energy(ratio: float) -> tuple[float, float]:
    """Least energy of the spinning bar, and that of frozen loads, for unit mass, length, speed.

    psi is the largest value of 2 f u - A u'^2 over all u with f = s A, so that its derivative by
    the area is 2 s u - u'^2, which is minus a number lambda everywhere: u'^2 = lambda + 2 s u. The
    force A u' falls by s A, and is that of the end mass at the end; lambda makes the mass one.
    """
    s = np.linspace(0.0, 1.0, 4001)

    def areas(level: float) -> tuple[Array, Array]:
        strain = _strain(s, level)
        rest = cumulative_trapezoid(s / strain, s, initial=0.0)
        return ratio * np.exp(rest[-1] - rest) / strain, strain

    def excess(level: float) -> float:
        return float(trapezoid(areas(level)[0], s)) - 1.0

    area, strain = areas(brentq(excess, 1e-3, 1e3))
    # frozen loads: the same strain c everywhere
    even = brentq(
        lambda c: trapezoid(ratio * np.exp((1.0 - s**2) / (2.0 * c)), s) / c - 1.0, 0.05, 50.0
    )
    return float(trapezoid(area * strain**2, s)), even**2


def _strain(s: Array, level: float) -> Array:
    """The strain u' = sqrt(level + 2 s u) from u(0) = 0, by the classical Runge-Kutta method."""

    def slope(at: float, u: float) -> float:
        return math.sqrt(level + 2.0 * at * u)

    u, strain, h = 0.0, [], float(s[1] - s[0])
    for at in s.tolist():
        strain.append(slope(at, u))
        first = slope(at, u)
        second = slope(at + 0.5 * h, u + 0.5 * h * first)
        third = slope(at + 0.5 * h, u + 0.5 * h * second)
        fourth = slope(at + h, u + h * third)
        u += h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    return np.array(strain)


def spinning_bar(comm: MPI.Comm, progress: Progress, *, ratio: float) -> dict[str, Any]:
    """Least compliance of a bar that spins with an end mass."""
    spin = 10.0
    force = DENSITY * THICKNESS * 0.05 * MEAN * spin**2
    optimum, frozen = spinning_energy(ratio)
    unit = force**2 / (YOUNG * THICKNESS * 0.05 * MEAN)
    row = _designed_bar(ratio, spin, unit * optimum, frozen / optimum)
    return {"case_text": f"spinning bar, end mass {ratio:g}", "ratio": ratio, **row}


def rod(comm: MPI.Comm, progress: Progress) -> dict[str, Any]:
    """Least mass of a rod with an end mass M, for a frequency of its motion along its axis.

    With x from the support and the frequency omega the mode u obeys (E A u')' = -omega^2 rho A u.
    The mass is least where the derivative of lambda = omega^2 by the area, E u'^2 - lambda rho u^2,
    is the same everywhere, so that u = sinh(k x) with k = omega sqrt(rho / E). Then E A u' at the
    end is omega^2 M u: A = M k tanh(b) cosh(b)^2 / (rho cosh(k x)^2) with b = k L, and the mass is
    sinh(b)^2 M. That of the even rod is b tan(b) M.

    The rod is wide, so that it does not bend; its first mode is that of shear, the second the one
    along the axis, as its Poisson's ratio is zero.
    """
    b, length, width, share = 1.0, 1.0, 3.0, 0.2
    domain = ffr.Domain.rectangle(MPI.COMM_SELF, length, width, elements=(40, 2), solid_columns=0)
    law = ffr.SIMP(exponent=1.0, floor=1e-9, mass=ffr.LinearMass())
    steel = ffr.PlaneStress(YOUNG, 0.0, DENSITY, THICKNESS)
    frame = ffr.TangentFrame("left")
    body = ffr.FlexibleBody(domain, steel, frame=frame, modes=12, interpolation=law)
    end = DENSITY * THICKNESS * width * length * share / (b * math.tan(b))
    weights = [ffr.PointMass(("rod", "right"), end)]
    mechanism = ffr.Mechanism({"rod": ffr.Placement()}, point_masses=weights)
    axial = ffr.Frequency("rod", number=2, point_masses=True)
    least = ffr.Constraint(axial, lower=b / length * math.sqrt(YOUNG / DENSITY) / (2.0 * math.pi))
    method = ffr.GeneralizedAlpha(1.0, 2)  # nothing is simulated
    problem = ffr.Problem({"rod": body}, mechanism, method, ffr.Mass("rod"), [least])
    sheet = Sheet(domain)
    start, optimum = np.full(sheet.size, share), math.sinh(b) ** 2 * end
    options = {"start": start, "volume": 0.9, "iterations": 40}
    row = optimised(problem, sheet, lambda result: result.psi / optimum, **options)
    return {"case_text": "rod for a frequency, b 1", **row}


class SharpDensities(ffr.DensityDesign):
    """Densities that are sharp from the first iteration."""

    def at(self, progress: float) -> "SharpDensities":
        return self


def vibrating_beam(
    comm: MPI.Comm,
    progress: Progress,
    *,
    elements: tuple[int, int] = (200, 25),
    iterations: tuple[int, int] = (50, 20),
) -> dict[str, Any]:
    """Largest first frequency of half a beam that is clamped at one end and pinned at the other.

    Published: 104.1 rad/s where all densities are 0.5, 288.7 rad/s of the design (J. Du, N. Olhoff,
    Structural and Multidisciplinary Optimization 34 (2007), doi:10.1007/s00158-007-0101-y).

    The beam has 8 x 1 m, E = 1e7 Pa, nu = 0.3 and 1 kg/m^3; a pin at half its height gives the
    first of both numbers. The first two frequencies of gray designs meet, where the lower one has a
    kink. The mean of both keeps them apart; then the first one alone is maximised.
    """
    length, start_speed, speed = 8.0, 104.1, 288.7
    corners = [np.array([0.0, -0.5]), np.array([length, 0.5])]
    cells = create_rectangle(MPI.COMM_SELF, corners, elements, CellType.quadrilateral)
    # in the middle of an end, of an odd number of cells one, of an even one two
    pin = (1.0 if elements[1] % 2 == 0 else 0.5) / elements[1]
    interfaces = {
        "left": lambda p: p[0] < 1e-9,
        "right": lambda p: (p[0] > length - 1e-9) & (np.abs(p[1]) < pin + 1e-9),
    }
    domain = ffr.Domain(cells, interfaces)
    law = ffr.SIMP(exponent=3.0, floor=1e-6, mass=ffr.SuppressedVoidMass())
    material, frame = ffr.PlaneStress(1e7, 0.3, 1.0, 1.0), ffr.TangentFrame("left")
    body = ffr.FlexibleBody(domain, material, frame=frame, modes=6, interpolation=law)
    mechanism = ffr.Mechanism({"beam": ffr.Placement()})
    method = ffr.GeneralizedAlpha(1.0, 2)  # nothing is simulated

    def problem(cluster: int) -> ffr.Problem:
        highest = -ffr.Frequency("beam", cluster=cluster, pinned=["right"])
        return ffr.Problem({"beam": body}, mechanism, method, highest)

    began, radius = process_time(), 2.25 / elements[1]
    design = ffr.DensityDesign(domain, radius=radius)
    even = problem(1).value({"beam": np.full(domain.n_cells, 0.5)}).psi
    options = {"volume": 0.5, "progress": False, "boundary": 0}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # material without strength makes no part
        apart = ffr.optimize(
            problem(2), design, design.even(0.5), iterations=iterations[0], **options
        )
        result = ffr.optimize(
            problem(1),
            SharpDensities(domain, radius=radius),
            apart.variables["beam"],
            iterations=iterations[1],
            **options,
        )
    return {
        "case_text": "beam that vibrates",
        "start": -2.0 * math.pi * even / start_speed,
        "reached": -2.0 * math.pi * result.psi / speed,
        "volume": result.evaluation.volume["beam"],
        "iterations": apart.iterations + result.iterations,
        "seconds": process_time() - began,
    }


# %% Outlines by dimensions
def _stations(places: Array) -> tuple[list[str], Callable[[Any], Any]]:
    """Names of heights at stations, and the symmetric outline with these heights."""
    names = [f"height{i}" for i in range(len(places))]

    def shape(heights: dict[str, float]) -> dict[str, Any]:
        half = 0.5 * np.array([heights[name] for name in names])
        outline = np.r_[np.c_[places, -half], np.c_[places, half][::-1]]
        return {"outline": Polygon(outline), "interfaces": _ends(places[-1])}

    return names, shape


def _ends(length: float) -> dict[str, Any]:
    return {"left": lambda p: p[0] < 1e-9, "right": lambda p: p[0] > length - 1e-9}


def spinning_arm(
    comm: MPI.Comm, progress: Progress, *, chi: float, least: str = "mass", iterations: int = 30
) -> dict[str, Any]:
    """Least mass of an arm that spins with an end mass, for a largest stress S; or the reverse.

    It has this stress everywhere: (S A)' = -rho omega^2 r A, and S A = M omega^2 L at the end
    r = L. So A = M omega^2 L / S exp(chi^2 (1 - (r / L)^2)) with chi = omega L / sqrt(2 S / rho),
    and the mass is sqrt(pi) chi exp(chi^2) erf(chi) M. No arm has less: each section must carry
    what is outside it. One mean of the stress over the arm cannot tell which station needs more.
    """
    length, limit = 0.3, 100e6
    speed = chi * math.sqrt(2.0 * limit / DENSITY) / length
    even = 1.4e-3  # height of the even arm that just meets the limit
    mass = DENSITY * length * THICKNESS * even * (1.0 - chi**2) / (2.0 * chi**2)
    lowest = mass * speed**2 * length / limit / THICKNESS
    names, shape = _stations(np.linspace(0.0, length, 7 if chi > 0.5 else 5))
    ranges = dict.fromkeys(names, (0.8 * lowest, 3.0 * even))
    start = dict.fromkeys(names, 1.3 * even)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # one triangle across is enough for what is only pulled
        design = ffr.DimensionDesign(shape, ranges, size=6e-3, start=start)
        domain = design.domain(MPI.COMM_SELF)
    steel = ffr.PlaneStress(YOUNG, 0.0, DENSITY, THICKNESS)
    body = ffr.FlexibleBody(domain, steel, frame=ffr.TangentFrame("left"), modes=8)
    hub = ffr.Moving(STILL, STILL, ffr.Motion.polynomial([0.0, speed]))
    mechanism = ffr.Mechanism(
        placements={"arm": ffr.Placement(angular_velocity=speed)},
        joints=[ffr.Weld(("arm", "left"), hub)],
        point_masses=[ffr.PointMass(("arm", "right"), mass)],
    )
    optimum = mass * math.sqrt(math.pi) * chi * math.exp(chi**2) * math.erf(chi)
    most = {"mass": (ffr.Mass("arm"), optimum), "stress": (ffr.PeakStress("arm"), limit)}
    objective, best = most.pop(least)
    ((given, (bounded, upper)),) = most.items()
    bound, method = ffr.Constraint(bounded, upper=upper), ffr.RadauIIA(1.0, steps=3)
    problem = ffr.Problem({"arm": body}, mechanism, method, objective, [bound])
    row = optimised(problem, design, lambda result: result.psi / best, iterations=iterations)
    return {"case_text": f"spinning arm for a {given}, chi {chi:g}", **row}


def _loaded(design: ffr.DimensionDesign, tip: float, mass: float) -> ffr.Problem:
    """A body that is held at its left end under a force at its right one, of at most a mass."""
    steel = ffr.PlaneStress(YOUNG, 0.0, DENSITY, THICKNESS)
    domain = design.domain(MPI.COMM_SELF)
    body = ffr.FlexibleBody(domain, steel, frame=ffr.TangentFrame("left"), modes=2)
    mechanism = ffr.Mechanism(
        placements={"body": ffr.Placement()},
        joints=[ffr.Weld(("body", "left"), ffr.Ground())],
        forces=[ffr.Force(("body", "right"), 0.0, tip)],
        start=ffr.StaticEquilibrium(),
    )
    bound = ffr.Constraint(ffr.Mass("body"), upper=mass)
    method = ffr.GeneralizedAlpha(1.0, 4)
    return ffr.Problem({"body": body}, mechanism, method, ffr.IntegralCompliance(), [bound])


def cantilever(comm: MPI.Comm, progress: Progress) -> dict[str, Any]:
    """Least compliance of a slender cantilever under a force at its end, by its heights.

    With x from the force the compliance is 12 P^2 / (E t) times the integral of x^2 / h^3, least
    for a given volume where x^2 / h^4 is the same everywhere: h = 3/2 sqrt(x / L) of its mean, and
    the integral is (2/3)^3 2/3 where the even height has 1/3.
    """
    length, height, tip = 1.0, 0.03, 1.0
    # dense at the end, where the optimum is a parabola; its height there is not quite zero
    places = length * (1.0 - np.linspace(1.0, 0.0, 8) ** 2)
    names, shape = _stations(places)
    start, bounds = dict.fromkeys(names, height), dict.fromkeys(names, (0.1 * height, 2 * height))
    design = ffr.DimensionDesign(shape, bounds, size=0.015, order=2, start=start)
    problem = _loaded(design, tip, DENSITY * THICKNESS * length * height)
    even = tip**2 * length**3 / (3.0 * YOUNG * THICKNESS * height**3 / 12.0)
    optimum = 16.0 / 27.0 * even
    row = optimised(problem, design, lambda result: result.psi / optimum, iterations=40)
    return {"case_text": "slender cantilever", **row}


def two_bars(comm: MPI.Comm, progress: Progress) -> dict[str, Any]:
    """Least compliance of two bars from a wall to a force, by their angle and width.

    Bars at the angle a to the normal of the wall carry P / (2 sin a) along L / cos a each, so that
    compliance times E V / (P L)^2 is 1 / (sin a cos a)^2: 4 at 45 degrees.
    """
    length, tip, width = 1.0, 1.0, 0.015

    def shape(numbers: dict[str, float]) -> dict[str, Any]:
        half, thick = numbers["half"], numbers["width"]
        out = half / length
        line = LineString([(-0.5, half + 0.5 * out), (length, 0.0), (-0.5, -half - 0.5 * out)])
        bars = line.buffer(0.5 * thick, cap_style="flat", join_style="mitre")
        outline = bars.intersection(box(0.0, -3.0, length, 3.0))
        return {"outline": outline, "interfaces": _ends(length)}

    bounds = {"half": (0.3, 1.8), "width": (0.3 * width, 3.0 * width)}
    start = {"half": 0.6, "width": width}
    design = ffr.DimensionDesign(shape, bounds, size=0.012, order=2, start=start)
    volume = 2.0 * math.sqrt(2.0) * width * length * THICKNESS
    problem = _loaded(design, tip, DENSITY * volume)
    optimum = 4.0 * (tip * length) ** 2 / (YOUNG * volume)
    row = optimised(problem, design, lambda result: result.psi / optimum, iterations=40)
    return {"case_text": "two bars on a wall", **row}


# %% Numbers of a machine
def drive(comm: MPI.Comm, progress: Progress) -> dict[str, Any]:
    """Least torque, in the mean square, that turns an inertia J by an angle D in a time T, at rest.

    The fourth derivative of the angle is zero, so that the angle is D (3 s^2 - 2 s^3) with s = t/T,
    the torque 6 J D / T^2 (1 - 2 s), and the integral of its square 12 J^2 D^2 / T^3.
    """
    inertia, turn, time = 2.0, 1.5, 0.8
    wheel = ffr.VolumeIntegrals.rigid(1.0, (0.0, 0.0), inertia, {"axle": (0.0, 0.0)})

    def machine(fourth: float, fifth: float) -> ffr.Mechanism:
        # 3 s^2 - 2 s^3 and two polynomials that rest at both ends
        own = np.array([0.0, 0.0, 3.0, -2.0, 0.0, 0.0])
        own += fourth * np.array([0.0, 0.0, 1.0, -2.0, 1.0, 0.0])
        own += fifth * np.array([0.0, 0.0, 1.0, -4.0, 5.0, -2.0])
        motion = ffr.Motion.polynomial((turn * own / time ** np.arange(6)).tolist())
        axle = ("wheel", "axle")
        joints = [ffr.Revolute(axle, ffr.Ground()), ffr.PrescribedAngle(axle, motion, name="motor")]
        return ffr.Mechanism({"wheel": ffr.Placement()}, joints)

    parameters = ffr.Parameters(fourth=(2.0, -8.0, 8.0), fifth=(-2.0, -8.0, 8.0))
    mechanism, moment = parameters.mechanism(machine), ffr.JointForce("motor")
    method = ffr.RadauIIA(time, steps=60)
    problem = ffr.Problem({"wheel": wheel}, mechanism, method, moment)
    optimum = 12.0 * inertia**2 * turn**2 / time**3
    scale = {"scale": lambda result: result.psi**2 * time / optimum}
    exact = ffr.MMA(tolerance=1e-9)
    row = optimised(problem, parameters, **scale, iterations=40, optimizer=exact)
    return {"case_text": "drive of an inertia", **row}


class Balance(ffr.Objective):
    """One and the square of a mean force relative to a ``size``.

    It and its logarithm, which is what the optimiser sees, are smooth where the force vanishes. The
    mean itself has a kink there, and its logarithm a pole: of that one stops at 2e-4.
    """

    def __init__(self, force: ffr.JointForce, size: float) -> None:
        self.force, self.size = force, size

    def evaluate(self, response: ffr.Response) -> float:
        return 1.0 + (self.force.evaluate(response) / self.size) ** 2

    def derivatives(self, response: ffr.Response) -> ffr.Derivatives:
        slope = 2.0 * self.force.evaluate(response) / self.size**2
        return self.force.derivatives(response).scaled(slope)


def four_bar(comm: MPI.Comm, progress: Progress, *, by: str) -> dict[str, Any]:
    """A four-bar whose counterweights cancel its shaking force, or springs its weight.

    A coupler whose center is on its line weighs, and shakes, like a mass at each of its pins. So
    each of the other links with its share turns about a fixed pin, and a counterweight, or a spring
    of no free length from above the pin, balances it at every angle: the optimum is zero.
    """
    crank, coupler, rocker, ground = 0.1, 0.3, 0.25, 0.35
    masses = {"crank": 0.5, "coupler": 1.2, "rocker": 0.8}
    behind, above, along, gravity = 0.08, 0.2, 0.07, 9.81
    lengths = {"crank": crank, "coupler": coupler, "rocker": rocker}
    bodies = {
        name: ffr.VolumeIntegrals.rigid(
            masses[name],
            (0.5 * length, 0.0),
            masses[name] * length**2 / 12.0,
            {"a": (0.0, 0.0), "b": (length, 0.0), "back": (-behind, 0.0), "hook": (along, 0.0)},
        )
        for name, length in lengths.items()
    }
    first = 0.7
    pin = crank * np.array([math.cos(first), math.sin(first)])
    base = np.array([ground, 0.0])
    apart = float(np.linalg.norm(base - pin))
    turned = math.atan2(*(base - pin)[::-1])
    inner = math.acos((coupler**2 + apart**2 - rocker**2) / (2.0 * coupler * apart))
    angle = turned + inner
    end = pin + coupler * np.array([math.cos(angle), math.sin(angle)])
    last = math.atan2(*(end - base)[::-1])
    # moments of the mass about the pins on the frame
    moments = [(0.5 * masses["crank"] + 0.5 * masses["coupler"]) * crank]
    moments.append((0.5 * masses["rocker"] + 0.5 * masses["coupler"]) * rocker)
    counter = by == "counterweights"
    wanted = [m / behind if counter else m * gravity / (above * along) for m in moments]
    time = 1.0 if counter else 1e5  # so slow that there is nothing but weight

    def machine(front: float, back: float) -> ffr.Mechanism:
        motion = ffr.Motion.polynomial([first, 2.0 * math.pi / time])
        numbers, pins = (front, back), (("crank", (0.0, 0.0)), ("rocker", (ground, 0.0)))
        joints = [
            ffr.Revolute(("crank", "a"), ffr.Ground(), name="A"),
            ffr.Revolute(("rocker", "a"), ffr.Ground((ground, 0.0)), name="D"),
            ffr.Revolute(("coupler", "a"), ("crank", "b")),
            ffr.Revolute(("coupler", "b"), ("rocker", "b")),
            ffr.PrescribedAngle(("crank", "a"), motion, name="motor"),
        ]
        springs = [
            ffr.SpringDamper((name, "hook"), ffr.Ground((x, above)), stiffness, length=0.0)
            for (name, (x, _)), stiffness in zip(pins, numbers, strict=True)
        ]
        weights = [
            ffr.PointMass((name, "back"), mass)
            for (name, _), mass in zip(pins, numbers, strict=True)
        ]
        centers = {"crank": ((0.0, 0.0), first), "coupler": (tuple(pin), angle)}
        centers["rocker"] = (tuple(base), last)
        return ffr.Mechanism(
            {name: ffr.Placement(*center) for name, center in centers.items()},
            joints,
            point_masses=weights if counter else [],
            forces=[] if counter else springs,
            gravity=(0.0, 0.0 if counter else -gravity),
        )

    bounds = {
        n: (0.4 * w, 1e-3 * w, 3.0 * w) for n, w in zip(("front", "back"), wanted, strict=True)
    }
    parameters = ffr.Parameters(**bounds)
    force = ffr.JointForce(("A", "D")) if counter else ffr.JointForce("motor")
    mechanism = parameters.mechanism(machine)

    def problem(objective: ffr.Objective, steps: int = 60) -> ffr.Problem:
        return ffr.Problem(bodies, mechanism, ffr.RadauIIA(time, steps=steps), objective)

    def forces(numbers: list[float], steps: int = 60) -> float:
        return problem(force, steps).at(np.array(numbers)).value({}).psi

    unbalanced = forces([1e-3 * w for w in wanted])

    def share(result: ffr.Result) -> float:
        return force.evaluate(result.problem.response(result.evaluation)) / unbalanced

    exact = ffr.MMA(tolerance=1e-15)
    options = {"iterations": 60, "optimizer": exact}
    row = optimised(problem(Balance(force, unbalanced)), parameters, share, **options)
    closed = {f"exact{steps}": forces(wanted, steps) / unbalanced for steps in (60, 240)}
    return {"case_text": f"four-bar by {by}", **row, **closed}


# %% A value that other codes have published
#: Compliance by uniform density
MOSAIC = {0.2: 0.0556488, 0.4: 0.00770596, 0.5: 0.00397532, 0.7: 0.00145609, 0.9: 0.00068616}


def mosaic(comm: MPI.Comm, progress: Progress) -> dict[str, Any]:
    """Compliance of a cantilever of hexahedra under a traction at its free end."""
    box_of = ffr.Domain.box(MPI.COMM_SELF, 2.0, 1.0, 1.0, elements=(8, 2, 4), solid_layers=0)
    law = ffr.SIMP(exponent=3.0, floor=1e-3)
    frame, solid = ffr.TangentFrame("left"), ffr.Isotropic(70e3, 0.3, 1.0)
    body = ffr.FlexibleBody(box_of, solid, frame=frame, modes=1, interpolation=law)
    points = box_of.space.tabulate_dof_coordinates()
    held, end = np.abs(points[:, 0]) < 1e-9, np.abs(points[:, 0] - 2.0) < 1e-9
    # of four elements that meet at a node each gives a quarter of its area, at edges two, at
    # corners one
    share = np.full(len(points), 1.0 / 8.0)
    for axis in (1, 2):
        share *= np.where(0.5 - np.abs(points[:, axis]) < 1e-9, 0.5, 1.0)
    force = np.zeros((len(points), 3))
    force[end, 2] = share[end]
    free = np.repeat(~held, 3)
    rows = []
    for density, theirs in MOSAIC.items():
        matrices = body.elasticity.assemble(np.full(box_of.n_cells, density))
        indptr, columns, values = matrices.stiffness.getValuesCSR()
        stiffness = csr_matrix((values, columns, indptr))[free][:, free]
        load = force.ravel()[free]
        ours = float(load @ spsolve(stiffness.tocsc(), load))
        rows.append(
            {"density": density, "ours": ours, "theirs": theirs, "error": ours / theirs - 1}
        )
    return {"rows": rows}


def report_known(study: Study, results: Results) -> None:
    """The tables."""
    rows = [row for _, row in results]
    study.table("known", [row for row in rows if "ours" in row and "exact60" not in row])
    study.table("known_balanced", [row for row in rows if "exact60" in row])
    study.table("known_published", [row for row in rows if "reached" in row])
    study.table("known_value", [value for row in rows for value in row.get("rows", [])])
    with study.picture(
        "Bars with an end mass: optimised, and by frozen loads", 1, 2, (8.0, 3.4)
    ) as (
        pulled,
        spinning,
    ):
        for panel, kind in ((pulled, "pulled bar"), (spinning, "spinning bar")):
            bars = [row for row in rows if row.get("case_text", "").startswith(kind)]
            line(panel, bars, "ratio", "frozen", "s-", ORANGE, label="loads frozen")
            line(panel, bars, "ratio", "ours", "o-", BLUE, label="optimised here")
            words = (kind, "end mass / mass of the bar", "relative to the optimum")
            plot(panel, *words, scales="x", legend="upper right")
