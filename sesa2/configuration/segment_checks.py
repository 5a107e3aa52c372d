"""What can be wrong with the segments of an arm and the backbones whose lengths are measured."""

from collections.abc import Callable

from sesa2.configuration.records import Configuration, LengthSection
from sesa2.errors import shown
from sesa2.shape.layout import SEGMENTS_TOLERANCE

Expect = Callable[[bool, str, str], bool]


def check_segments(c: Configuration, expect: Expect) -> None:
    """Note every mistake.

    Parameters
    ----------
    c
        whose values are each of the right kind and in their range.
    expect
        takes whether something is right, and where and what is wrong if it is not; gives the first back.
    """
    segments, n = c.segments, len(c.segments.lengths)
    total = sum(segments.lengths)
    whole = expect(
        not n or abs(total - c.arm.length) <= SEGMENTS_TOLERANCE,
        'segments.lengths',
        f'add up to {total:.9g} m, expected arm.length, {c.arm.length:g} m',
    )
    radii = len(segments.radii)
    expect(
        radii in (0, 1, n),
        'segments.radii',
        f'has {radii} entries, expected 1 or {n}: one for all or one per segment',
    )
    stretch = segments.stretch
    expect(
        len(stretch) == 2 and stretch[0] < stretch[-1],
        'segments.stretch',
        f'got {shown(list(stretch))}, expected two numbers, the smaller first',
    )
    names = c.lengths.names
    if not names:
        expect(
            c.lengths == LengthSection(), 'lengths.names', 'is missing, and other keys of lengths are given'
        )
        return
    expect(n > 0, 'segments.lengths', 'is missing, and lengths needs it')
    if _check_backbones(c.lengths, n, expect) and whole and n:
        _check_told(c, expect)


def _check_backbones(a: LengthSection, n_segments: int, expect: Expect) -> bool:
    """Whether names, and what is said of each, are right."""
    n, right = len(a.names), True
    for i, name in enumerate(a.names):
        right &= expect(name != '', f'lengths.names[{i}]', 'is empty, expected a name')
        right &= expect(name not in a.names[:i], f'lengths.names[{i}]', f'got {shown(name)} a second time')
    for key in ('segments', 'starts', 'angles', 'radii', 'scales', 'offsets'):
        got = len(getattr(a, key))
        right &= expect(
            got in (1, n),
            f'lengths.{key}',
            f'has {got} entries, expected 1 or {n}: one for all or one per name',
        )
    if n_segments:
        for key in ('segments', 'starts'):
            for i, k in enumerate(getattr(a, key)):
                right &= expect(
                    k <= n_segments, f'lengths.{key}[{i}]', f'got {k}, expected 1 to {n_segments}, a segment'
                )
    for i, scale in enumerate(a.scales):
        right &= expect(scale != 0.0, f'lengths.scales[{i}]', 'got 0.0, expected another number')
    if right:
        starts, ends = (each * n if len(each) == 1 else each for each in (a.starts, a.segments))
        for i, (first, last) in enumerate(zip(starts, ends, strict=True)):
            place = f'lengths.starts[{i if len(a.starts) > 1 else 0}]'
            right &= expect(
                first <= last,
                place,
                f'got {first}, which comes after the segment that {a.names[i]} ends with, {last}',
            )
    return right


def _check_told(c: Configuration, expect: Expect) -> None:
    """The length of each segment follows from its backbones."""
    backbones = c.backbones
    for k in backbones.untold:
        own = [
            name
            for name, through in zip(c.lengths.names, backbones.through[:, k - 1], strict=True)
            if through
        ]
        got = f'{len(own)} run through it, {", ".join(own)}' if own else 'none runs through it'
        expect(
            False,
            'lengths.segments',
            f'do not tell the length of segment {k}: {got}; expected one on its axis (radius 0), or around it three at '
            'angles well apart or two opposite each other',
        )
