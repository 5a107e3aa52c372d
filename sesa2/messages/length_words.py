"""What has to be said of measured lengths, for people: the same live and of a recording."""

from collections.abc import Sequence

from sesa2.estimation.arrivals import lag_in_words
from sesa2.estimation.sweep_lengths import SweepLengths
from sesa2.messages.length_messages import LengthIntake


def about_lengths(names: Sequence[str], intake: LengthIntake, lengths: SweepLengths) -> list[str]:
    """Messages and samples that were refused, and jumps, one sentence each."""
    lines = [
        f'lengths: {n} messages not used: {reason}: {intake.example[reason]}'
        for reason, n in intake.refused.items()
    ]
    for name, track in zip(names, lengths.tracks, strict=True):
        lines += [f'{name}: {n} samples not used: {reason}' for reason, n in track.dropped.items()]
        if track.jumps:
            lines.append(f'{name}: its length jumped {track.jumps} times, faster than {track.rate_max:g} m/s')
    return lines


def about_clocks(names: Sequence[str], lengths: SweepLengths) -> list[str]:
    """Clocks that are off, one sentence each."""
    return [f'{names[k]}: {lag_in_words(lag, "the IMUs")}' for k, lag in lengths.lags.items()]
