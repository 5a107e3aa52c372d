"""Where magnets and magnetometers are drawn, against the exact shape and scipy; and in which colour."""

import time
from dataclasses import replace

import numpy as np
import pytest
from magnetic_bag import configuration
from scipy.spatial.transform import Rotation

from sesa2.messages.colours import Colour
from sesa2.shape.reading_faults import ReadingFault
from sesa2.viewer.live import Diagnostic
from sesa2.viewer.magnet_poses import DOUBTFUL, UNUSED, WELL, WRONG, MagnetPoses, magnetometer_colour

# Bent in each segment another way; the first and the last are longer than at rest.
Q = np.array([0.5, -0.9, 0.114, -0.6, 0.4, 0.110, 1.0, 0.3, 0.113])


@pytest.fixture(scope='module')
def bent():
    """Configuration, exact shape, and what is heard of it: as an estimator says where links end and how they lie."""
    c = configuration()
    section = replace(
        c.magnetometers,
        masked=(3,),
        azimuths=tuple(np.linspace(-3.0, 3.0, 12)),
        axial_offsets=(0.004,),
        mount_orientations=tuple(Rotation.random(12, random_state=4).as_quat().ravel()),
    )
    c = replace(c, magnetometers=section)
    model = c.create_model('magnetic')
    exact = model.kinematics.backbone(Q)
    oriented_at = np.concatenate([model.link_middles[:1], model.link_middles[:-1], model.link_ends[-1:]])
    heard = np.hstack([exact.positions(model.link_ends), exact.orientations(oriented_at)])
    return c, exact, MagnetPoses(c, model.link_ends), heard


def test_magnets_are_on_the_bent_and_stretched_backbone(bent):
    _, exact, poses, heard = bent
    s = np.array([0.055, 0.165, 0.275])
    found = poses.magnets(heard)
    # Between two ends it is a chord: 5 mm of a circle of 0.1 m.
    np.testing.assert_allclose(found[:, :3], exact.positions(s), atol=1e-4)
    turned = Rotation.from_quat(found[:, 3:]) * Rotation.from_quat(exact.orientations(s)).inv()
    assert turned.magnitude().max() < 1e-3


def test_magnetometers_are_beside_it_and_turned_as_they_are_mounted(bent):
    c, exact, poses, heard = bent
    found = poses.magnetometers(heard)
    assert len(found) == 12  # the one that is masked, too
    m = c.magnetometers
    link = Rotation.from_quat(exact.orientations(np.repeat([0.11, 0.22, 0.33], 4)))
    about_z = Rotation.from_rotvec(np.outer(m.azimuths, [0.0, 0.0, 1.0]))
    beside = np.stack([0.013 * np.cos(m.azimuths), 0.013 * np.sin(m.azimuths), np.full(12, 0.004)], axis=-1)
    at = exact.positions(np.repeat([0.11, 0.22, 0.33], 4)) + link.apply(beside)
    turned = link * about_z * Rotation.from_quat(np.reshape(m.mount_orientations, (-1, 4)))
    off = (Rotation.from_quat(found[:, 3:]) * turned.inv()).magnitude()
    # The tip is oriented exactly; where two segments meet, half a link of each is between.
    np.testing.assert_allclose(found[8:, :3], at[8:], atol=1e-9)
    assert off[8:].max() < 1e-6
    np.testing.assert_allclose(found[:, :3], at, atol=4e-4)
    assert off.max() < 0.03


def said(level=1, rate='40.0', **faults):
    values = {'rate_hz': rate} | {f'sweeps {name}': str(n) for name, n in faults.items()}
    return Diagnostic(level, '', values, time.monotonic())


@pytest.mark.parametrize(
    ('diagnostic', 'masked', 'colour'),
    [
        (said(0), False, WELL),
        (said(0), True, UNUSED),
        (None, False, UNUSED),
        (said(1, rate='0.0'), False, UNUSED),
        (said(silent=3), False, UNUSED),
        (said(saturated=3), False, WRONG),
        (said(repeating=3), False, WRONG),
        (said(jumping=3), False, DOUBTFUL),
        (said(doubted=3), False, DOUBTFUL),
        (said(jumping=2, saturated=30), False, WRONG),
        (said(jumping=30, saturated=2), False, DOUBTFUL),
        (said(1), False, DOUBTFUL),  # late, or unstamped
        (said(2), False, WRONG),  # two publishers
    ],
)
def test_the_colour_tells_how_it_does(diagnostic: Diagnostic, masked: bool, colour: Colour):
    assert magnetometer_colour(diagnostic, masked) == colour


def test_every_fault_has_a_colour_of_its_own_kind():
    for fault in set(ReadingFault) - {ReadingFault.NONE}:
        assert magnetometer_colour(said(**{fault.name.lower(): 1})) != WELL
