"""Motive's CSV as its documentation describes it, of three versions."""

import numpy as np
import pytest

from sesa2.mocap.formats import read_motion_capture

ONE_BODY = ['Rotation'] * 4 + ['Position'] * 3 + ['Mean Marker Error']


def first_line(**more):
    keys = {
        'Format Version': '1.23',
        'Take Name': 'arm, "second"',
        'Capture Frame Rate': '120.000000',
        'Export Frame Rate': '120.000000',
        'Rotation Type': 'Quaternion',
        'Length Units': 'Meters',
        'Coordinate Space': 'Global',
    } | more
    return [
        cell
        for key, value in keys.items()
        for cell in (key, f'"{value}"'.replace('arm, "second"', 'arm, ""second""'))
    ]


def take(types, names, quantities, axes, rows, *, parents=False, ids=None, **keys):
    header = [
        first_line(**keys),
        [],
        ['', 'Type', *types],
        ['', 'Name', *names],
        ['', 'ID', *(ids or [f'"{i}"' for i in range(len(names))])],
        *([['', 'Parent', *[''] * len(names)]] if parents else []),
        ['', '', *quantities],
        ['Frame', 'Time (Seconds)', *axes],
    ]
    return header + rows


def markers(rows, **keys):
    names = ['Arm:M1'] * 3 + ['Arm:M2'] * 3
    return take(['Marker'] * 6, names, ['Position'] * 6, 'XYZXYZ', rows, **keys)


@pytest.mark.parametrize('how', ['plain', 'windows', 'latin', 'parents', 'semicolons'])
def test_markers(export, how):
    rows = [
        [0, '0.000000', '0.1', '0.2', '0.3', '', '', ''],
        [1, '0.008333', '0.4', '0.5', '0.6', '1', '2', '3'],
    ]
    options = {
        'windows': {'newline': '\r\n', 'encoding': 'utf-8-sig'},
        'latin': {'encoding': 'latin-1'},
        'semicolons': {'delimiter': ';'},
    }.get(how, {})
    keys = {'Take Name': 'Prüfstand'} if how == 'latin' else {}
    if how == 'semicolons':
        rows = [[str(cell).replace('.', ',') for cell in row] for row in rows]
        keys = {'Capture Frame Rate': '120,000000', 'Export Frame Rate': '120,000000'}
    capture = read_motion_capture(
        export('take.csv', markers(rows, parents=how == 'parents', **keys), **options)
    )
    assert capture.kind == 'Motive CSV'
    assert list(capture.bodies) == ['Arm:M1', 'Arm:M2']
    one, two = capture.bodies.values()
    np.testing.assert_allclose(one.times, [0.0, 0.008333])
    np.testing.assert_allclose(one.positions, [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    np.testing.assert_array_equal(two.positions, [[np.nan] * 3, [1, 2, 3]])
    assert one.orientations is None
    assert 'y axis points up' in capture.axes


@pytest.mark.parametrize(
    ('unit', 'metre'), [('Meters', 1.0), ('Millimeters', 1e-3), ('Centimeters', 1e-2), ('Inches', 0.0254)]
)
def test_the_unit_of_the_header(export, unit, metre):
    path = export('take.csv', markers([[0, 0, 1, 2, 3, 4, 5, 6]], **{'Length Units': unit}))
    np.testing.assert_allclose(
        read_motion_capture(path).bodies['Arm:M2'].positions, [[4 * metre, 5 * metre, 6 * metre]]
    )


def test_an_unknown_unit_is_refused(export):
    path = export('take.csv', markers([[0, 0, 1, 2, 3, 4, 5, 6]], **{'Length Units': 'Cubits'}))
    with pytest.raises(Exception, match="unit of length 'Cubits', expected m, mm"):
        read_motion_capture(path)


def bodies(rows, axes='XYZWXYZ', rotation='Quaternion'):
    quantities = ['Rotation'] * (len(axes) - 3) + ['Position'] * 3
    types = ['Rigid Body'] * (len(axes) + 1) + ['Rigid Body Marker'] * 3
    names = ['imu_2'] * (len(axes) + 1) + ['imu_2:Marker1'] * 3
    return take(
        types,
        names,
        [*quantities, 'Mean Marker Error', *['Position'] * 3],
        [*axes, '', *'XYZ'],
        rows,
        **{'Rotation Type': rotation},
    )


def test_rigid_bodies_and_their_markers(export):
    rows = [[0, 0, 0.5, -0.5, 0.1, 0.7, 1, 2, 3, 1e-4, 7, 8, 9], [1, 0.01, *[''] * 8, 7, 8, 9]]
    capture = read_motion_capture(export('take.csv', bodies(rows)))
    assert list(capture.bodies) == ['imu_2', 'imu_2:Marker1']
    body = capture.bodies['imu_2']
    np.testing.assert_allclose(body.orientations, [[0.5, -0.5, 0.1, 0.7], [np.nan] * 4])
    np.testing.assert_allclose(body.positions, [[1, 2, 3], [np.nan] * 3])
    np.testing.assert_allclose(capture.bodies['imu_2:Marker1'].positions, [[7, 8, 9], [7, 8, 9]])


def test_the_order_of_a_quaternion_is_that_of_its_axes(export):
    capture = read_motion_capture(
        export('take.csv', bodies([[0, 0, 0.7, 0.5, -0.5, 0.1, 1, 2, 3, 0, 7, 8, 9]], 'WXYZXYZ'))
    )
    np.testing.assert_allclose(capture.bodies['imu_2'].orientations, [[0.5, -0.5, 0.1, 0.7]])


def test_euler_angles_are_no_orientations(export):
    capture = read_motion_capture(
        export('take.csv', bodies([[0, 0, 10, 20, 30, 1, 2, 3, 0, 7, 8, 9]], 'XYZXYZ', 'XYZ'))
    )
    assert capture.bodies['imu_2'].orientations is None
    np.testing.assert_allclose(capture.bodies['imu_2'].positions, [[1, 2, 3]])
    assert 'Euler angles' in capture.notes[0]


def test_measured_markers_are_preferred_to_solved_ones(export):
    path = export(
        'take.csv',
        take(
            ['Rigid Body Marker'] * 3 + ['Marker'] * 3,
            ['A:1'] * 6,
            ['Position'] * 6,
            'XYZXYZ',
            [[0, 0, 1, 2, 3, 4, 5, 6]],
        ),
    )
    np.testing.assert_allclose(read_motion_capture(path).bodies['A:1'].positions, [[4, 5, 6]])


def test_a_header_without_names_is_refused(export):
    content = [row for row in markers([[0, 0, 1, 2, 3, 4, 5, 6]]) if row[1:2] != ['Name']]
    with pytest.raises(Exception, match="without the line 'Name' in its header"):
        read_motion_capture(export('take.csv', content))
