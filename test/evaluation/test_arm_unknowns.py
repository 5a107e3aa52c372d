"""Corrections go into the keys of the configuration, on what stands there already."""

import numpy as np
import slipping_arm as arm
from scipy.spatial.transform import Rotation

from sesa2.configuration import validate
from sesa2.evaluation.arm_unknowns import ArmUnknowns

ASKEW = Rotation.from_euler('x', 90.0, degrees=True)


def test_mountings_turn_about_the_axes_of_the_link_and_headings_add():
    c = validate(
        {
            'arm': {'length': 0.3},
            'imus': {
                'ids': [3, 1],
                'positions': [0.1, 0.3],
                'mount_orientations': ASKEW.as_quat().tolist(),
                'headings': [0.4],
            },
            'models': ['pcc_exact'],
        }
    )
    unknowns = ArmUnknowns(c, 'pcc_exact', np.array([False, True]))
    assert [item.name for item in unknowns.items] == [
        'IMU 1: mounting about x',
        'IMU 1: mounting about y',
        'IMU 1: mounting about z',
        'IMU 1: heading',
    ]
    got = unknowns.corrected(np.array([0.0, 0.2, 0.0, 0.1]))
    np.testing.assert_allclose(got.headings, [0.4, 0.5])
    mountings = Rotation.from_quat(got.mountings)
    np.testing.assert_allclose((mountings[0] * ASKEW.inv()).magnitude(), 0.0, atol=1e-8)
    np.testing.assert_allclose((mountings[1] * ASKEW.inv()).as_rotvec(), [0.0, 0.2, 0.0], atol=1e-8)


def test_scale_and_offset_are_on_top_of_those_known():
    c = arm.configuration(racks=False, lengths={'names': ['string'], 'scales': [0.5], 'offsets': [0.1]})
    unknowns = ArmUnknowns(c, 'pcc_delta', np.array([True]))
    x = np.zeros(len(unknowns.items))
    x[-2:] = 0.02, 0.003
    before, after = (k.backbones.calibrated([0.3]) for k in (c, unknowns.corrected(x)))
    np.testing.assert_allclose(after, 1.02 * before + 0.003)


def test_racks_share_a_scale_and_an_offset_where_the_model_has_no_slip():
    c = arm.configuration(models=['pcc_exact', 'pcc_delta'])
    unknowns = ArmUnknowns(c, 'pcc_exact', np.array([True]))
    assert [item.name for item in unknowns.items][-2:] == ['b1, b2, b3: scale', 'b1, b2, b3: offset']
    x = np.zeros(len(unknowns.items))
    x[-2:] = 0.02, 0.003
    np.testing.assert_allclose(
        unknowns.corrected(x).backbones.calibrated([0.1, 0.2, 0.3]), [0.105, 0.207, 0.309]
    )


def test_affine_curvature_and_slip_are_added():
    c = arm.configuration(pcc_delta={'affine': [0.1], 'slip': [0.1, 0.2, 0.01], 'twist': 'heading'})
    unknowns = ArmUnknowns(c, 'pcc_delta', np.array([True]))
    got = unknowns.corrected(np.array([0.0, 0.0, 0.0, 0.0, 0.2, 0.05, -0.05, 0.001])).options['pcc_delta']
    np.testing.assert_allclose(got.affine, [0.3])
    np.testing.assert_allclose(got.slip, [0.15, 0.15, 0.011])
    assert [item.key for item in unknowns.items][-4:] == ['pcc_delta.affine', *3 * ['pcc_delta.slip']]


def test_corrections_are_told_in_their_units():
    c = arm.configuration()
    items = {item.name: item for item in ArmUnknowns(c, 'pcc_delta', np.array([True])).items}
    assert items['IMU 1: heading'].signed(np.deg2rad(-2.5)) == '-2.50'
    assert items['slip always'].told(0.0123) == '12.30'
    assert items['affine curvature'].signed(0.35) == '+0.350'
