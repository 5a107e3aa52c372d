"""The arm as a Cosserat rod in PyElastica: clamped at its base, heavy, held by a hand."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import elastica as ea
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from sesa2.shape.rotations import FloatArray, rotate, slerp
from sesa2.twin.trial import TrialError

GRAVITY = 9.80665
ELEMENT_LENGTH = 0.010
# Fraction of the stability limits that a time step takes.
_COURANT = 0.4
RECORD_INTERVAL = 0.005
NODES_EVERY = 20


@dataclass(frozen=True)
class Rod:
    """A round rod of soft rubber; the defaults are those of the paper's arm.

    Attributes
    ----------
    length, radius
        m.
    hand_position
        arc length at which the hand holds it, m.
    youngs_modulus
        Pa; the shear modulus is a third of it (incompressible).
    density
        kg/m³.
    damping
        rate at which all velocities decay, 1/s.
    """

    length: float = 0.660
    radius: float = 0.0125
    hand_position: float = 0.480
    youngs_modulus: float = 2e6
    density: float = 1200.0
    damping: float = 2.0

    @property
    def n_elements(self) -> int:
        """Elements of 10 mm, at least 30."""
        return max(30, round(self.length / ELEMENT_LENGTH))

    @property
    def bending_stiffness(self) -> float:
        """EI, N m²."""
        return self.youngs_modulus * np.pi * self.radius**4 / 4.0

    @property
    def twisting_stiffness(self) -> float:
        """GJ, N m²: two thirds of EI."""
        return 2.0 / 3.0 * self.bending_stiffness

    @property
    def cross_section(self) -> float:
        """A, m²."""
        return np.pi * self.radius**2

    @property
    def hand_stiffness(self) -> float:
        """Spring of the hand, N/m: that of the rod itself against stretching, 1500 on the paper's arm."""
        return self.youngs_modulus * self.cross_section / self.length

    @property
    def hand_damping(self) -> float:
        """Damper of the hand, N s/m: a third of the rod's impedance to stretching waves, 8 on the paper's arm.

        A step that resolves those waves, which pass an element of mass m in m over impedance, then resolves the hand
        too, whatever the size of the arm.
        """
        return self.cross_section * float(np.sqrt(self.youngs_modulus * self.density)) / 3.0

    @property
    def longest_step(self) -> float:
        """Time step that resolves stretching waves along an element and the shear mode of a cross-section, s."""
        stretch = self.length / self.n_elements / np.sqrt(self.youngs_modulus / self.density)
        shear = self.radius / np.sqrt(self.youngs_modulus / 3.0 / self.density)
        return _COURANT * float(min(stretch, shear))


class RodStates(NamedTuple):
    """Motion of the rod, every 5 ms. Positions are in world axes with their origin at the base.

    Attributes
    ----------
    times : (n,)
        s, from 0.
    orientations : (n, n_orientations, 4)
        q_WL where asked for, x y z w.
    points : (n, n_points, 3)
        positions where asked for, m.
    nodes : (ceil(n / 20), n_elements + 1, 3)
        positions of the ends of all elements, at every 20th time, m.
    energies : (n,)
        kinetic, elastic and potential together, J.
    """

    times: FloatArray
    orientations: FloatArray
    points: FloatArray
    nodes: FloatArray
    energies: FloatArray


class _Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
    """What of PyElastica is used."""


class _Hand(ea.NoForces):
    """A spring and a damper between a node and a moving point; on demand a torque about the rod's own axis."""

    def __init__(self, node: int, stiffness: float, damping: float, path: Any, torque: Any):
        super().__init__()
        self._node, self._stiffness, self._damping = node, stiffness, damping
        times, self._positions = path
        self._rate = 1.0 / (times[1] - times[0])
        self._velocities = np.gradient(self._positions, times, axis=0)
        self._torque = torque

    def apply_forces(self, system: Any, time: float = 0.0) -> None:
        sample = time * self._rate
        i = min(int(sample), len(self._positions) - 2)
        behind = (sample - i) / self._rate
        velocity = self._velocities[i]
        stretch = self._positions[i] + behind * velocity - system.position_collection[:, self._node]
        slip = velocity - system.velocity_collection[:, self._node]
        system.external_forces[:, self._node] += self._stiffness * stretch + self._damping * slip

    def apply_torques(self, system: Any, time: float = 0.0) -> None:
        if self._torque is not None:
            # Torques are in the element's own frame, whose third axis is the tangent.
            system.external_torques[2, self._node] += self._torque(time)


def simulate_rod(
    rod: Rod,
    base: FloatArray,
    seconds: float,
    hand: tuple[FloatArray, FloatArray] | None,
    *,
    orientations_at: FloatArray,
    points_at: FloatArray,
    torque: Callable[[float], float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> RodStates:
    """Integrate the rod from rest, straight from its clamp.

    Position Verlet with a uniform damper and a Laplacian filter of order 7 against ripples between elements.

    Parameters
    ----------
    rod
        the rod.
    base : (4,)
        q_WB, x y z w, of the clamp; gravity is along −z of the world.
    seconds
        how long.
    hand : (n,) and (n, 3)
        equally spaced times from 0, s, and positions of the hand, world axes, m; None: it hangs free.
    orientations_at, points_at : (n_orientations,), (n_points,)
        arc lengths at which to record orientations and positions, m.
    torque
        torque of the hand about the rod's axis, N m, as a function of time, s.
    progress
        called with the fraction done, now and then.

    Returns
    -------
    The motion.

    Raises
    ------
    TrialError
        the integration has become unstable.
    """
    steps = int(np.ceil(RECORD_INTERVAL / rod.longest_step))
    dt = RECORD_INTERVAL / steps
    system, body = _assemble(rod, base, hand, torque, dt)
    edges = np.linspace(0.0, rod.length, rod.n_elements + 1)
    middles = 0.5 * (edges[:-1] + edges[1:])
    right = np.clip(np.searchsorted(middles, orientations_at), 1, rod.n_elements - 1)
    elements = np.stack([right - 1, right])
    # Positions between the nodes are linear in those of the nodes: a cubic spline's weights, worked out once.
    weights = CubicSpline(edges, np.eye(len(edges)))(points_at)

    n = int(np.ceil(seconds / RECORD_INTERVAL)) + 1
    frames = np.empty((n, *elements.shape, 3, 3))
    points, energies = np.empty((n, len(weights), 3)), np.empty(n)
    nodes = np.empty((len(range(0, n, NODES_EVERY)), len(edges), 3))
    stepper = ea.PositionVerlet()
    time = np.float64(0.0)
    for i in range(n):
        # PyElastica keeps the axes of an element as rows; as columns they are R_WL.
        frames[i] = body.director_collection[:, :, elements].transpose(2, 3, 1, 0)
        points[i] = weights @ body.position_collection.T
        energies[i] = _energy(body)
        if not np.isfinite(energies[i]):
            raise TrialError(
                f'the simulated arm, {rod.length:g} m long and {rod.radius:g} m in radius, flew apart after'
                f" {time:.2f} s; expected an arm more like the paper's (0.66 m and 0.0125 m)"
            )
        if i % NODES_EVERY == 0:
            nodes[i // NODES_EVERY] = body.position_collection.T
            if progress is not None:
                progress(i / (n - 1))
        if i < n - 1:
            with np.errstate(all='ignore'):  # what cannot be computed shows in the energy
                for _ in range(steps):
                    time = stepper.step(system, time, dt)
    if progress is not None:
        progress(1.0)
    return RodStates(
        times=np.arange(n, dtype=float) * RECORD_INTERVAL,
        orientations=_between(frames, (orientations_at - middles[elements[0]]) / (edges[1] - edges[0])),
        points=points,
        nodes=nodes,
        energies=energies,
    )


def _assemble(rod: Rod, base: FloatArray, hand: Any, torque: Any, dt: float) -> tuple[_Simulator, Any]:
    system = _Simulator()
    axes = rotate(base, np.eye(3))
    body = ea.CosseratRod.straight_rod(
        n_elements=rod.n_elements,
        start=np.zeros(3),
        direction=axes[2],
        normal=axes[0],
        base_length=rod.length,
        base_radius=rod.radius,
        density=rod.density,
        youngs_modulus=rod.youngs_modulus,
    )
    system.append(body)
    system.constrain(body).using(
        ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    system.add_forcing_to(body).using(ea.GravityForces, acc_gravity=np.array([0.0, 0.0, -GRAVITY]))
    if hand is not None:
        node = round(rod.hand_position / rod.length * rod.n_elements)
        system.add_forcing_to(body).using(_Hand, node, rod.hand_stiffness, rod.hand_damping, hand, torque)
    if rod.damping > 0.0:
        system.dampen(body).using(
            ea.AnalyticalLinearDamper, uniform_damping_constant=rod.damping, time_step=np.float64(dt)
        )
        system.dampen(body).using(ea.LaplaceDissipationFilter, filter_order=7)
    system.finalize()
    return system, body


def _between(frames: FloatArray, fraction: FloatArray) -> FloatArray:
    """Slerp between two frames, (n, 2, n_orientations, 3, 3); held beyond the middles of the first and last element."""
    q = Rotation.from_matrix(frames.reshape(-1, 3, 3)).as_quat().reshape(*frames.shape[:3], 4)
    return slerp(q[:, 0], q[:, 1], np.clip(fraction, 0.0, 1.0))


@np.errstate(all='ignore')
def _energy(body: Any) -> float:
    height = float(body.mass @ body.position_collection[2])
    return float(
        body.compute_translational_energy()
        + body.compute_rotational_energy()
        + body.compute_bending_energy()
        + body.compute_shear_energy()
        + GRAVITY * height
    )
