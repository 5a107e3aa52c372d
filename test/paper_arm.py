"""The arm of Baaij et al., as the package describes it, and the same simulated by magpylib and scipy's rotations."""

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.spatial.transform import Rotation

from sesa2.sensing.magnetometry.magnetic_readings import MagneticReadings, MagnetometerPlaces, MagnetPlaces
from sesa2.sensing.magnetometry.ring_magnet import RingMagnet
from sesa2.shape.kinematics import create_kinematics
from sesa2.shape.kinematics.coordinate_limits import CoordinateLimits

REAL = RingMagnet(0.006, 0.012, 0.006, 1.45)
SIMULATED = RingMagnet(0.012, 0.024, 0.006, 1.45)  # what the paper's tables were computed with
EARTH = 65e-6  # T
NOISE = 0.71e-6  # T


class PaperArm:
    """Sensors look towards the base, tilted by psi about the tangential direction, o = −(sin ψ e_r + cos ψ e_z)."""

    def __init__(
        self,
        segments=3,
        per_segment=3,
        *,
        magnet=REAL,
        tilt=0.0,
        radius=0.013,
        earth=(0.0, 0.0, 0.0),
        axes='z',
        kinematics='pcc',
        noise=0.71e-6,
        bend_max=1.6,
        largest=5e-3,
    ):
        self.family, self.magnet, self.axes, self.earth = (
            kinematics,
            magnet,
            axes,
            np.asarray(earth, dtype=float),
        )
        affine = kinematics == 'affine'
        self.lengths = np.full(segments, 0.2 if affine else 0.11)
        self.magnet_s = np.array([0.05, 0.15]) if affine else 0.055 + 0.11 * np.arange(segments)
        planes = np.array([0.0, 0.1, 0.2]) if affine else np.cumsum(self.lengths)
        self.sensor_s = np.repeat(planes, per_segment)
        n = len(self.sensor_s)
        self.azimuths = np.tile(2 * np.pi / per_segment * np.arange(per_segment), len(planes))
        self.radius, self.tilt = radius, tilt
        self.limits = CoordinateLimits(create_kinematics(kinematics, self.lengths), bend_max, (0.95, 1.10))
        mounting = (
            Rotation.from_rotvec([0.0, tilt, 0.0]) * Rotation.from_quat([1.0, 0.0, 0.0, 0.0])
        ).as_quat()
        self.predictor = MagneticReadings(
            self.limits,
            MagnetPlaces((magnet,) * len(self.magnet_s), self.magnet_s),
            MagnetometerPlaces(
                ids=tuple(range(1, n + 1)),
                positions=self.sensor_s,
                radii=np.full(n, radius),
                azimuths=self.azimuths,
                axial_offsets=np.zeros(n),
                mountings=np.tile(mounting, (n, 1)),
                axes=(axes,) * n,
                gains=np.ones(n),
                offsets=np.zeros(n * len(axes)),
                noise=noise,
                range=largest,
            ),
            earth,
        )

    def simulate(self, q, base=None):
        """Readings (n, n_readings) by magpylib of shapes (n, n_coordinates), T."""
        magpylib = pytest.importorskip('magpylib', reason='magpylib is not installed')
        magnets = [self._pose(q, s) for s in self.magnet_s]
        source = magpylib.magnet.CylinderSegment(
            polarization=(0, 0, self.magnet.remanence),
            dimension=(
                self.magnet.inner_diameter / 2,
                self.magnet.outer_diameter / 2,
                self.magnet.height,
                0,
                360,
            ),
        )
        earth = self.earth if base is None else Rotation.from_quat(base).inv().apply(self.earth)
        out = []
        for s, azimuth in zip(self.sensor_s, self.azimuths, strict=True):
            p, turn = self._pose(q, s)
            radial = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            at = p + turn.apply(self.radius * radial)
            field = np.broadcast_to(earth, (len(q), 3))
            for centre, frame in magnets:
                field = field + frame.apply(source.getB(frame.inv().apply(at - centre)))
            z = -(np.sin(self.tilt) * radial + np.cos(self.tilt) * np.array([0.0, 0.0, 1.0]))
            x = np.cos(self.tilt) * radial - np.sin(self.tilt) * np.array([0.0, 0.0, 1.0])
            own = [x, np.cross(z, x), z] if self.axes == 'xyz' else [z]
            out += [np.einsum('ni,ni->n', field, turn.apply(axis)) for axis in own]
        return np.stack(out, axis=-1)

    def simulate_build(self, build, q):
        """Readings of shapes by magpylib of an arm like this that is built as a MagneticReadings says, T."""
        magpylib = pytest.importorskip('magpylib', reason='magpylib is not installed')
        sensors, out = build.magnetometers, []
        poses = [self._pose(q, s) for s in build.magnets.positions]
        sources = [
            magpylib.magnet.CylinderSegment(
                polarization=(0, 0, m.remanence),
                dimension=(m.inner_diameter / 2, m.outer_diameter / 2, m.height, 0, 360),
            )
            for m in build.magnets.magnets
        ]
        for i, s in enumerate(sensors.positions):
            p, turn = self._pose(q, s)
            azimuth = sensors.azimuths[i]
            lever = sensors.radii[i] * np.array([np.cos(azimuth), np.sin(azimuth)])
            at = p + turn.apply([*lever, sensors.axial_offsets[i]])
            field = np.broadcast_to(build.earth_field, (len(q), 3))
            for source, (centre, frame) in zip(sources, poses, strict=True):
                field = field + frame.apply(source.getB(frame.inv().apply(at - centre)))
            own = turn * Rotation.from_euler('z', azimuth) * Rotation.from_quat(sensors.mountings[i])
            read = own.inv().apply(field) * sensors.gains[i]
            out.append(read if sensors.axes[i] == 'xyz' else read[:, 2:])
        return np.concatenate(out, axis=1) + sensors.offsets

    def _pose(self, q, s):
        """Position (n, 3) and scipy rotations of places s of shapes; a joint is the end of the segment before it."""
        p, turn, start = np.zeros((len(q), 3)), Rotation.identity(len(q)), 0.0
        own = q.reshape(len(q), len(self.lengths), -1)
        for k, length in enumerate(self.lengths):
            v = min(max((s - start) / length, 0.0), 1.0)
            local, rotation = (_affine if self.family == 'affine' else _arc)(own[:, k], v)
            p, turn = p + turn.apply(local), turn * rotation
            start += length
            if s <= start + 1e-12:
                break
        return p, turn


def _arc(own, v):
    """Corrected A.1, by the angle and the direction of the bend."""
    x, y, length = own.T
    angle, direction = np.hypot(x, y), np.arctan2(y, x)
    safe = np.where(angle < 1e-9, 1.0, angle)
    out = np.where(angle < 1e-9, 0.0, length * (1.0 - np.cos(v * angle)) / safe)
    up = np.where(angle < 1e-9, length * v, length * np.sin(v * safe) / safe)
    p = np.stack([out * np.cos(direction), out * np.sin(direction), up], axis=-1)
    return p, Rotation.from_rotvec(v * np.stack([-y, x, 0.0 * x], axis=-1))


def _affine(own, v):
    """Corrected A.2 of a plane: curvature linear, its direction constant (bend0 and bend1 are parallel)."""
    x0, y0, x1, y1, length = own.T
    direction = np.arctan2(y0 + y1, x0 + x1)
    c, s = np.cos(direction), np.sin(direction)
    mean, slope = c * x0 + s * y0, c * x1 + s * y1

    def angle(v):
        return (mean - 0.5 * slope) * v + 0.5 * slope * v * v

    out = length * quad_vec(lambda w: np.sin(angle(w)), 0.0, v)[0]
    up = length * quad_vec(lambda w: np.cos(angle(w)), 0.0, v)[0]
    return np.stack([c * out, s * out, up], axis=-1), Rotation.from_rotvec(
        angle(v)[:, None] * np.stack([-s, c, 0.0 * c], axis=-1)
    )


def lemniscate(segments, n=400):
    """Coordinates (n, 3 segments) of the paper's motion: ± 45°, elongation 0 to 5.5 mm, 10 s."""
    turn = 2.0 * np.pi * np.arange(n) / n
    q = np.empty((n, segments, 3))
    for i in range(segments):
        phase = turn + 2.0 * np.pi * i / segments
        q[:, i, 0] = np.pi / 4 * np.sin(2.0 * phase)
        q[:, i, 1] = np.pi / 4 * np.sin(phase)
        q[:, i, 2] = 0.11 + 0.00275 * (1.0 + np.sin(phase))
    return q.reshape(n, -1)


def flower(n=400):
    """Coordinates (n, 5) of the paper's motion for affine curvature, 10 s; κ0, κ1 are angles (erratum of A.2)."""
    t = 10.0 * np.arange(n) / n
    wave = 0.5 + 0.5 * np.sin(2 * np.pi * 0.3 * t)
    kappa0 = np.pi / 4 * wave
    kappa1 = np.pi * (0.1 + 0.9 * wave)
    phi = 2.0 * np.pi * t / 10.0
    # The paper's azimuth turns the tip from −y (φ = 0) towards +x.
    towards = np.stack([np.sin(phi), -np.cos(phi)], axis=-1)
    bend0 = (kappa0 + 0.5 * kappa1)[:, None] * towards
    length = 0.2 + 0.00275 * (1.0 + np.sin(2 * np.pi * 0.1 * t))
    return np.column_stack([bend0, kappa1[:, None] * towards, length])


def errors(estimated, true):
    """The paper's eq. 13 of each coordinate, per cent."""
    rms = np.sqrt(np.mean((estimated - true) ** 2, axis=0))
    return 100.0 * rms / np.ptp(true, axis=0)


def as_in_the_paper(q):
    """κ0, κ1 (rad), φ and length of coordinates (n, 5) whose bends are parallel, φ without jumps."""
    towards = q[:, :2] + q[:, 2:4]
    phi = np.unwrap(np.arctan2(towards[:, 0], -towards[:, 1]))
    along = np.stack([np.sin(phi), -np.cos(phi)], axis=-1)
    mean, slope = np.sum(along * q[:, :2], axis=1), np.sum(along * q[:, 2:4], axis=1)
    return np.column_stack([mean - 0.5 * slope, slope, phi, q[:, 4]])
