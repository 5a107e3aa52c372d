"""Segments and measured lengths in a configuration: every mistake is found, with its place."""

import numpy as np
import pytest

from sesa2.configuration import ConfigurationError, files, validate

THREE = {'names': ['a', 'b', 'c'], 'angles': [0.0, 2.0944, 4.1888], 'radii': [0.03]}


def values(segments=None, lengths=None):
    out = {'arm': {'length': 0.3}, 'imus': {'ids': [2, 5], 'positions': [0.1, 0.3]}}
    return out | {k: v for k, v in (('segments', segments), ('lengths', lengths)) if v is not None}


def test_a_configuration_with_lengths_survives_the_file():
    segments = {'lengths': [0.1, 0.2], 'radii': [0.02], 'bend_max': 1.2, 'stretch': [0.9, 1.2]}
    lengths = {
        'names': ['a', 'b', 'c', 'd'],
        'segments': [1, 1, 1, 2],
        'starts': [1, 1, 1, 2],
        'angles': [0.0, 2.0944, 4.1888, 0.0],
        'radii': [0.03, 0.03, 0.03, 0.0],
        'scales': [1.01, 1.0, 1.0, -1.0],
        'offsets': [0.12, 0.12, 0.12, 0.5],
        'timeout': 0.5,
    }
    c = validate(values(segments, lengths))
    assert files.parse(files.dump(c), 'again') == c
    assert c.has_lengths
    assert c.layout.stretches
    assert c.layout.segment_ends.tolist() == [0.0, 0.1, 0.3]
    said = c.backbones.read(np.array([0.1, 0.1, 0.1, 0.25]))
    np.testing.assert_allclose(said.lengths, [0.22 + 0.001 / 3.0, 0.25], atol=1e-4)


def test_segments_alone_and_none():
    c = validate(values({'lengths': [0.1, 0.2]}))
    assert c.layout.segment_lengths == (0.1, 0.2)
    assert not c.layout.stretches
    none = validate(values())
    assert none.layout.segment_lengths == ()
    assert not none.has_lengths
    assert none.options['pcc'].segments == (2, 2)  # an option of a model, no section


@pytest.mark.parametrize(
    ('segments', 'lengths', 'expected'),
    [
        ({'lengths': [0.1, 0.1]}, None, 'segments.lengths: add up to 0.2 m, expected arm.length, 0.3 m'),
        ({'lengths': [0.4, -0.1]}, None, 'segments.lengths[1]: got -0.1, expected more than 0'),
        ({'lengths': [0.3], 'radii': [0.1, 0.1]}, None, 'segments.radii: has 2 entries, expected 1 or 1'),
        ({'lengths': [0.3], 'stretch': [1.1, 0.9]}, None, 'segments.stretch: got [1.1, 0.9], expected two'),
        ({'lengths': [0.3], 'stretch': [1.1]}, None, 'segments.stretch: got [1.1], expected two'),
        ({'lengths': [0.3], 'bend_max': 7.0}, None, 'segments.bend_max: got 7.0'),
        (None, {'names': ['a']}, 'segments.lengths: is missing, and lengths needs it'),
        ({'lengths': [0.3]}, {'radii': [0.03]}, 'lengths.names: is missing, and other keys of lengths are given'),
        ({'lengths': [0.3]}, {'names': ['a', 'a']}, "lengths.names[1]: got 'a' a second time"),
        ({'lengths': [0.3]}, {'names': ['']}, 'lengths.names[0]: is empty'),
        ({'lengths': [0.3]}, THREE | {'angles': [0.0, 1.0]}, 'lengths.angles: has 2 entries, expected 1 or 3'),
        ({'lengths': [0.3]}, THREE | {'segments': [2]}, 'lengths.segments[0]: got 2, expected 1 to 1, a segment'),
        ({'lengths': [0.3]}, THREE | {'starts': [1, 1, 3]}, 'lengths.starts[2]: got 3, expected 1 to 1, a segment'),
        ({'lengths': [0.3]}, THREE | {'segments': [0]}, 'lengths.segments[0]: got 0, expected at least 1'),
        (
            {'lengths': [0.1, 0.2]},
            {'names': ['a', 'b'], 'segments': [1, 1], 'starts': [1, 2]},
            'lengths.starts[1]: got 2, which comes after the segment that b ends with, 1',
        ),
        ({'lengths': [0.3]}, {'names': ['a'], 'scales': [0.0]}, 'lengths.scales[0]: got 0.0'),
        ({'lengths': [0.3]}, {'names': ['a'], 'radii': [-0.1]}, 'lengths.radii[0]: got -0.1, expected at least 0'),
        ({'lengths': [0.3]}, {'names': ['a'], 'timeout': 0.0}, 'lengths.timeout: got 0.0'),
        (
            {'lengths': [0.1, 0.2]},
            THREE,
            'lengths.segments: do not tell the length of segment 2: none runs through it; expected one on its axis',
        ),
        (
            {'lengths': [0.3]},
            {'names': ['a', 'b'], 'angles': [0.0, 1.5], 'radii': [0.03]},
            'lengths.segments: do not tell the length of segment 1: 2 run through it, a, b; expected one on its axis',
        ),
    ],
)  # fmt: skip
def test_a_mistake_in_segments_or_lengths_is_named(segments, lengths, expected):
    with pytest.raises(ConfigurationError) as caught:
        validate(values(segments, lengths))
    found = [f'{m.place}: {m.message}' for m in caught.value.mistakes]
    assert any(m.startswith(expected) for m in found), found


def test_all_mistakes_in_them_come_at_once():
    with pytest.raises(ConfigurationError) as caught:
        validate(
            values(
                {'lengths': [0.1], 'stretch': [1.0]},
                {'names': ['a', 'a'], 'segments': [2], 'angles': [0.0] * 3, 'scales': [0.0]},
            )
        )
    assert len(caught.value.mistakes) == 6
