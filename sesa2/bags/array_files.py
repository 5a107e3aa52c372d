"""Results as files that other programs read: CSV, NumPy's npz, MATLAB's mat, and trajectories as TUM has them."""

import csv
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sesa2.bags.estimate_arrays import EstimateArrays, ModelArrays
from sesa2.errors import Sesa2Error
from sesa2.messages.results import link_names
from sesa2.messages.topic_names import of_model
from sesa2.partial_files import partial_path, sweep_partials
from sesa2.shape.rotations import FloatArray
from sesa2.time import NS

_POSITION, _QUATERNION = ('x [m]', 'y [m]', 'z [m]'), ('qx', 'qy', 'qz', 'qw')
_BLOCK = 1024  # rows that are turned into Python's numbers at once


def write_arrays(estimate: EstimateArrays, out: str | Path) -> list[Path]:
    """Write results into a file whose ending says which kind.

    `.csv`: a row an instant, a first line that names the columns: `time_s`, then by the topic that each was on, for
    example `pcc/joint_states:pcc_001_x [rad]`, `pcc/markers:M1_x [m]`, `pcc/markers:M1_qx`, `pcc/tip:pose_x [m]`,
    `pcc/shape:000_x [m]`, `pcc_delta/coordinates:segment_1_bend_x [rad]`. Empty: not there. `sesa2
    evaluate` takes it as truth.

    `.npz` and `.mat`: arrays `time_s`, `stamps_ns`, `frame`, `marker_names`, `marker_arc_lengths_m`, and for each model
    (`pcc/joints_rad` in npz, a struct `pcc` in mat) `joint_names`, `joints_rad`, `markers_m`,
    `marker_orientations_xyzw`, `tip_m`, `tip_orientation_xyzw`, `backbone_m`, `backbone_orientations_xyzw`,
    `backbone_arc_lengths_m`; of models that have coordinates `coordinate_names` and `coordinates_rad_m` (lengths in m).

    `.tum`: a trajectory a file, `time tx ty tz qx qy qz qw` in s and m. OUT is the tip's by the first model; beside it
    `<name>_<model>.tum` are the tips by the others and `<name>_<model>_<marker>.tum` the markers.

    Parameters
    ----------
    estimate
        the results.
    out
        file to write; it must not exist.

    Returns
    -------
    The files written. They have temporary names until all are whole.

    Raises
    ------
    Sesa2Error
        one exists or cannot be written, the ending is another, or SciPy is not there for a `.mat`.
    """
    out = Path(out)
    kind = out.suffix.lower()
    if kind not in WRITERS:
        raise Sesa2Error(f'{out}: ends in {kind or "nothing"!r}, expected {", ".join(WRITERS)}')
    parts = WRITERS[kind](estimate, out)
    there = [path for path in parts if path.exists()]
    if there:
        raise Sesa2Error(f'{there[0]}: exists already, expected the name of a new file')
    for path in parts:
        sweep_partials(path)
    partial = {path: partial_path(path) for path in parts}
    try:
        for path, write in parts.items():
            write(partial[path])
        for path, temporary in partial.items():
            temporary.rename(path)
    except OSError as error:
        raise Sesa2Error(f'{out}: cannot be written: {error.strerror or error}') from None
    finally:
        for temporary in partial.values():
            temporary.unlink(missing_ok=True)
    return list(parts)


# A file, and what writes it under another name.
_Parts = dict[Path, Callable[[Path], None]]


def _csv(estimate: EstimateArrays, out: Path) -> _Parts:
    header, columns = ['time_s'], []
    for name, model in estimate.models.items():
        for names, values in _columns(estimate, name, model):
            header += names
            columns.append(values.reshape(len(values), -1))
    table = np.concatenate(columns, axis=1)

    def write(path: Path) -> None:
        with path.open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file, lineterminator='\n')
            writer.writerow(header)
            for start in range(0, len(table), _BLOCK):
                block = table[start : start + _BLOCK]
                rows = block.tolist()
                if np.isnan(block).any():
                    rows = [['' if v != v else v for v in row] for row in rows]
                times = map(_seconds, estimate.stamps_ns[start : start + _BLOCK].tolist())
                writer.writerows([time, *row] for time, row in zip(times, rows, strict=True))

    return {out: write}


def _columns(estimate: EstimateArrays, name: str, m: ModelArrays) -> Iterator[tuple[list[str], FloatArray]]:
    """Names of the columns, and the numbers in them."""
    joint_states, markers, tip, shape = (
        of_model(name, k) for k in ('joint_states', 'markers', 'tip', 'shape')
    )
    yield [f'{joint_states}:{joint} [rad]' for joint in m.joint_names], m.joints
    bodies = [f'{markers}:{marker}' for marker in estimate.configuration.markers.names]
    yield _named(bodies, _POSITION + _QUATERNION), np.concatenate([m.markers, m.marker_orientations], axis=-1)
    yield (
        _named([f'{tip}:pose'], _POSITION + _QUATERNION),
        np.concatenate([m.tip, m.tip_orientation], axis=-1),
    )
    yield _named([f'{shape}:{i:03d}' for i in range(m.backbone.shape[1])], _POSITION), m.backbone
    yield [f'{joint_states}:{joint}_velocity [rad/s]' for joint in m.joint_names], m.joint_velocities
    links = link_names(name, m.link_lengths.shape[1])
    yield [f'{joint_states}:{link}_l [m]' for link in links], m.link_lengths
    yield [f'{joint_states}:{link}_l_velocity [m/s]' for link in links], m.link_velocities
    coordinates, units = of_model(name, 'coordinates'), {True: 'm', False: 'rad'}
    yield (
        [f'{coordinates}:{c} [{units[c.endswith("_length")]}]' for c in m.coordinate_names],
        m.coordinates,
    )


def _named(bodies: Iterable[str], components: Iterable[str]) -> list[str]:
    return [f'{body}_{component}' for body in bodies for component in components]


def _seconds(stamp_ns: int) -> str:
    """A stamp in s, exactly: a float keeps a quarter of a microsecond of today's."""
    seconds, rest = divmod(abs(stamp_ns), NS)
    return f'{"-" if stamp_ns < 0 else ""}{seconds}.{rest:09d}'


def _shared(estimate: EstimateArrays) -> dict[str, Any]:
    markers = estimate.configuration.markers
    return {
        'time_s': estimate.times_s,
        'stamps_ns': estimate.stamps_ns,
        'frame': estimate.frame,
        'marker_names': np.array(markers.names, dtype=str),
        'marker_arc_lengths_m': np.array(markers.positions),
    }


def _of_model(m: ModelArrays) -> dict[str, Any]:
    stretching = {'link_lengths_m': m.link_lengths, 'link_velocities_m_per_s': m.link_velocities}
    return {
        'joint_names': np.array(m.joint_names, dtype=str),
        'joints_rad': m.joints,
        'joint_velocities_rad_per_s': m.joint_velocities,
        'markers_m': m.markers,
        'marker_orientations_xyzw': m.marker_orientations,
        'tip_m': m.tip,
        'tip_orientation_xyzw': m.tip_orientation,
        'backbone_m': m.backbone,
        'backbone_orientations_xyzw': m.backbone_orientations,
        'backbone_arc_lengths_m': m.backbone_positions,
        **(stretching if m.link_lengths.shape[1] else {}),
        **_coordinates(m),
    }


def _coordinates(m: ModelArrays) -> dict[str, Any]:
    if not m.coordinate_names:
        return {}
    return {'coordinate_names': np.array(m.coordinate_names, dtype=str), 'coordinates_rad_m': m.coordinates}


def _npz(estimate: EstimateArrays, out: Path) -> _Parts:
    arrays = _shared(estimate)
    for name, model in estimate.models.items():
        arrays |= {f'{name}/{key}': value for key, value in _of_model(model).items()}

    def write(path: Path) -> None:
        with path.open('wb') as file:
            np.savez_compressed(file, **arrays)

    return {out: write}


def _mat(estimate: EstimateArrays, out: Path) -> _Parts:
    try:
        from scipy.io import savemat
    except ImportError as error:
        raise Sesa2Error(f"a .mat file needs SciPy ({error}): pip install 'sesa2[mat]'") from None
    content = _shared(estimate)
    # MATLAB's texts of different lengths stand in a cell array.
    content['marker_names'] = _cells(content['marker_names'])
    for name, model in estimate.models.items():
        fields = _of_model(model)
        names = {key: _cells(value) for key, value in fields.items() if key.endswith('_names')}
        content[name] = {**fields, **names}

    def write(path: Path) -> None:
        with path.open('wb') as file:
            savemat(file, content, do_compression=True, oned_as='column')

    return {out: write}


def _cells(texts: np.ndarray) -> np.ndarray:
    return texts.astype(object).reshape(-1, 1)


def _tum(estimate: EstimateArrays, out: Path) -> _Parts:
    parts: _Parts = {}
    for name, m in estimate.models.items():
        tip = out.with_name(f'{out.stem}_{name}{out.suffix}') if parts else out
        parts[tip] = _tum_writer(estimate.stamps_ns, m.tip, m.tip_orientation)
        for k, marker in enumerate(estimate.configuration.markers.names):
            path = out.with_name(f'{out.stem}_{name}_{marker.replace("/", "-")}{out.suffix}')
            parts[path] = _tum_writer(estimate.stamps_ns, m.markers[:, k], m.marker_orientations[:, k])
    return parts


def _tum_writer(
    stamps_ns: np.ndarray, positions: FloatArray, orientations: FloatArray
) -> Callable[[Path], None]:
    poses = np.concatenate([positions, orientations], axis=-1)
    there = ~np.isnan(poses).any(axis=-1)

    def write(path: Path) -> None:
        with path.open('w', encoding='utf-8') as file:
            file.write('# time tx ty tz qx qy qz qw\n')
            for stamp, row in zip(stamps_ns[there].tolist(), poses[there].tolist(), strict=True):
                file.write(f'{_seconds(stamp)} {" ".join(map(repr, row))}\n')

    return write


WRITERS: dict[str, Callable[[EstimateArrays, Path], _Parts]] = {
    '.csv': _csv,
    '.npz': _npz,
    '.mat': _mat,
    '.tum': _tum,
}
