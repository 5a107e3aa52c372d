"""Gaps of streams: found where messages are missing, and nowhere else."""

import numpy as np

from sesa2.bags.stream_gaps import StreamGaps

MS = 1_000_000


def taken(stamps):
    gaps = StreamGaps()
    for stamp in stamps:
        gaps.take(int(stamp))
    return gaps.n_gaps, gaps.n_missing


def test_a_stream_that_jitters_has_none():
    rng = np.random.default_rng(0)
    stamps = 10**18 + 10 * MS * np.arange(5000) + (4 * MS * rng.uniform(-1, 1, 5000)).astype(np.int64)
    assert taken(stamps) == (0, 0)


def test_what_is_missing_is_counted():
    stamps = 10**18 + 10 * MS * np.arange(1000)
    kept = np.delete(stamps, np.r_[100:105, 400:500, 700:702])
    assert taken(kept) == (3, 107)


def test_another_rate_is_usual_after_a_while():
    stamps = np.concatenate([10 * MS * np.arange(1, 101), 1000 * MS + 50 * MS * np.arange(1, 101)])
    gaps, missing = taken(stamps)
    assert gaps <= 15
    assert missing <= 60
    again = np.concatenate([stamps, stamps[-1] + 50 * MS * np.arange(1, 101)])
    assert taken(again) == (gaps, missing)


def test_stamps_that_go_back_or_are_none_begin_anew():
    stamps = 10**18 + 10 * MS * np.arange(100)
    assert taken([*stamps, *stamps, *([0] * 10), *(stamps + 10**15)]) == (0, 0)
