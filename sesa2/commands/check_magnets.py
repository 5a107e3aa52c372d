"""`sesa2 check`, what magnets and magnetometers can tell of the arm."""

import numpy as np

from sesa2.commands.arguments import warn
from sesa2.configuration import Configuration
from sesa2.configuration.description import table
from sesa2.errors import Sesa2Error
from sesa2.sensing.magnetometry.magnet_survey import MagnetSurvey, survey_magnets
from sesa2.shape.models.magnetic import Magnetic

# A swing of so few times the noise tells little.
_WEAK = 30.0


def check_magnets(c: Configuration) -> None:
    """Print what the readings tell, and what they do not.

    Raises
    ------
    Sesa2Error
        the arm can bend a magnetometer so near to a magnet that its field is not known there.
    """
    model = c.create_model('magnetic')
    assert isinstance(model, Magnetic)
    survey = survey_magnets(model.predictor)
    names, of_row = model.predictor.names, model.predictor.sensor_of
    ids, range_, noise = (
        c.magnetometers.places(c.layout.segment_ends).ids,
        c.magnetometers.range,
        c.magnetometers.noise,
    )
    rows = []
    for i, own in enumerate(ids):
        mine = of_row == i
        k = int(survey.nearest[i].argmin())
        rows.append(
            (
                own,
                f'{1e3 * survey.nearest[i, k]:.1f} to magnet {k + 1}',
                f'{1e3 * survey.largest[mine].max():.3f} ({100.0 * survey.largest[mine].max() / range_:.0f} %)',
                f'{survey.swing[mine].max() / noise:.0f}',
                'no' if names[i] in survey.needed else 'yes',
            )
        )
    q, low, high = np.rad2deg(c.segments.bend_max), *c.segments.stretch
    print(
        f'\nReadings of shapes bent up to {q:.0f}° a segment and {low:g} to {high:g} long: at order '
        f'{model.predictor.order} the series leaves out at most {1e6 * survey.series_error:.2g} µT'
    )
    head = ('id', 'nearest [mm]', 'largest [mT] (of range)', 'swing / noise', 'can be spared')
    print('\n'.join(line.rstrip() for line in table(head, rows)))
    n = len(of_row)
    print(
        f'\nExpected errors by the noise, median of shapes: {n} readings for {n - survey.spare} coordinates, '
        f'at least {n - survey.spare} are needed'
    )
    print('\n'.join(line.rstrip() for line in _deviations(model, survey)))
    if survey.unseen:
        print(f'\nWithout a magnetometer and a magnet on either side: {_stretches(survey)}')
    warn(_doubts(c, survey, ids))
    if survey.too_near:
        near = ', '.join(
            f'magnetometer {ids[i]} and magnet {k + 1} {1e3 * survey.nearest[i, k]:.1f} mm'
            for i, k in survey.too_near
        )
        raise Sesa2Error(
            f'too near when the arm is bent as segments.bend_max and stretch allow: {near}, expected at least '
            f'{1e3 * survey.trusted.max():.1f} mm: nearer than that the field is not known'
        )


def _deviations(model: Magnetic, survey: MagnetSurvey) -> list[str]:
    names, scales = model.kinematics.coordinate_names, model.predictor.limits.scales
    rows = []
    for name, deviation, scale, noise in zip(
        names, survey.deviations, scales, np.full(len(names), 1e6 * model.predictor.noise[0]), strict=True
    ):
        length = 'length' in name
        value, unit = (1e3 * deviation, 'mm') if length else (np.rad2deg(deviation), '°')
        rows.append(
            (name, f'{value:.2g} {unit}', f'{value / noise:.2g} {unit}', f'{100.0 * deviation / scale:.2g} %')
        )
    return table(('coordinate', 'error', 'per µT', 'of its largest'), rows)


def _stretches(survey: MagnetSurvey) -> str:
    return ', '.join(f'{begin:.3f} to {end:.3f} m' for begin, end in survey.unseen)


def _doubts(c: Configuration, survey: MagnetSurvey, ids: tuple[int, ...]) -> list[str]:
    doubts = []
    largest = survey.largest.max()
    if largest > c.magnetometers.range:
        doubts.append(
            f'readings go up to {1e3 * largest:.3g} mT, expected less than magnetometers.range, '
            f'{1e3 * c.magnetometers.range:g} mT: such are left out (fields of two magnets add)'
        )
    weak = survey.swing < _WEAK * c.magnetometers.noise
    if weak.any():
        doubts.append(
            f'{np.count_nonzero(weak)} readings change by less than {_WEAK:g} times the noise over all shapes: they '
            'tell little'
        )
    if survey.untold:
        of = ', '.join(dict.fromkeys(name for each in survey.untold for name in each.names))
        doubts.append(
            f'in {100.0 * survey.untold_share:.0f} % of the shapes the readings do not tell something, usually {of}: '
            'more magnetometers, or such with axes xyz'
        )
    elif survey.needed:
        doubts.append(
            f'{len(survey.needed)} of {len(ids)} magnetometers cannot be spared: when one fails, a direction is lost; '
            'and which one fails is not told by the readings of one instant'
        )
    if survey.unseen:
        doubts.append(
            f'{_stretches(survey)}: how the arm bends there no magnetometer sees; it is taken from the rest of the '
            'segment, and no residual tells where that is wrong'
        )
    return doubts
