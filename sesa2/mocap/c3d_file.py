"""C3D: markers, and rigid bodies where it has rotations; read by the library ezc3d (extra `mocap`).

Source: c3d.org, "The C3D file format"; the parameter block's byte 2 is 0x50 in every file.
"""

import numpy as np

from sesa2.mocap.body_names import about_namesakes, told_apart
from sesa2.mocap.capture import MocapError, MotionCapture, TrackedBody, metres_in
from sesa2.mocap.export_file import ExportFile
from sesa2.shape.rotations import from_matrix

KIND = 'C3D'


def matches(file: ExportFile) -> bool:
    """Whether it is a C3D file."""
    return file.data[1:2] == b'\x50' and (file.path.suffix.lower() == '.c3d' or b'\0' in file.data[:512])


def read(file: ExportFile) -> MotionCapture:
    """Read it.

    Raises
    ------
    MocapError
        ezc3d is not installed or does not read it, or it has no markers.
    """
    try:
        import ezc3d
    except ImportError:
        raise MocapError(
            f"{file.name}: reading C3D needs ezc3d: pip install 'sesa2[mocap]', or export a CSV"
        ) from None
    try:
        c3d = ezc3d.c3d(str(file.path))
    except Exception as error:  # a damaged file makes its parser stumble in any way
        raise MocapError(f'{file.name} is no whole C3D file: {error or type(error).__name__}') from None
    point = c3d['parameters']['POINT']
    labels = [
        label.strip() for key in sorted(point) if key.startswith('LABELS') for label in point[key]['value']
    ]
    points = c3d['data']['points']  # x y z 1, marker, frame; NaN where it was not seen
    rate = float(c3d['header']['points']['frame_rate'])
    if not points.size or not rate > 0.0:
        raise MocapError(f'{file.name}: no markers in this C3D file, or no rate ({rate:g} Hz)')
    metre = metres_in((point.get('UNITS', {}).get('value') or ['mm'])[0] or 'mm', file.name)
    times = (int(c3d['header']['points']['first_frame']) + np.arange(points.shape[2])) / rate
    positions = metre * points[:3]
    names = told_apart([label or f'marker {k + 1}' for k, label in enumerate(labels[: points.shape[1]])])
    bodies = {name: TrackedBody(times, positions[:, k].T) for k, name in enumerate(names)}
    bodies |= _rotations(c3d, metre)
    return MotionCapture(KIND, bodies, notes=tuple(about_namesakes(names, file.name)))


def _rotations(c3d: dict, metre: float) -> dict[str, TrackedBody]:
    """Rigid bodies: 4 × 4 matrices of a group ROTATION."""
    matrices = c3d['data'].get('rotations')
    group = c3d['parameters'].get('ROTATION')
    if matrices is None or not np.size(matrices) or not group:
        return {}
    labels = group.get('LABELS', {}).get('value') or []
    rate = float(group.get('RATE', {}).get('value', [0.0])[0]) or float(c3d['header']['points']['frame_rate'])
    bodies = {}
    for k, label in enumerate(labels[: matrices.shape[2]]):
        pose = np.moveaxis(matrices[:, :, k], -1, 0)
        seen = np.abs(np.linalg.det(np.nan_to_num(pose[:, :3, :3])) - 1.0) < 0.1
        q = np.full((len(pose), 4), np.nan)
        q[seen] = from_matrix(pose[seen][:, :3, :3])
        position = np.where(seen[:, None], metre * pose[:, :3, 3], np.nan)
        bodies[label.strip()] = TrackedBody(np.arange(len(pose)) / rate, position, q)
    return bodies
