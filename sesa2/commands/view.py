"""`sesa2 view`: a recording as one page with a time line, for papers and colleagues."""

import argparse
from pathlib import Path

import numpy as np

from sesa2.commands.arguments import names, not_negative, positive
from sesa2.configuration import files
from sesa2.errors import Sesa2Error
from sesa2.messages.poses import read_path, read_pose_array
from sesa2.messages.results import TYPES
from sesa2.messages.topic_names import of_model
from sesa2.time import NS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument('bag', metavar='BAG', type=Path, help='bag that `replay` or the recorder wrote')
    parser.add_argument(
        '--html', required=True, type=Path, metavar='FILE', help='page to write; must not exist'
    )
    parser.add_argument('--models', type=names, metavar='A,B', help='only these models')
    parser.add_argument(
        '--start', type=not_negative, default=0.0, metavar='S', help='begin there, s (default: 0)'
    )
    parser.add_argument(
        '--duration', type=positive, default=30.0, metavar='S', help='show so much, s (default: 30)'
    )


def run(options: argparse.Namespace) -> int:
    """Write the page."""
    from sesa2.bags.reading import read_configuration
    from sesa2.viewer.film import view_html

    if options.html.exists():
        raise Sesa2Error(f'{options.html}: exists already, expected the name of a new page')
    text = read_configuration(options.bag)
    if text is None:
        raise Sesa2Error(f'{options.bag}: has no topic configuration, expected a bag that sesa2 wrote')
    c = files.parse(text, f'configuration in {options.bag}')
    chosen = options.models or c.models
    times, backbones, markers = _read(options.bag, chosen, options.start, options.duration)
    page = view_html(c, times, backbones, markers)
    try:
        options.html.write_text(page, encoding='utf-8')
    except OSError as error:
        raise Sesa2Error(f'{options.html}: cannot be written: {error.strerror}') from None
    print(f'{options.html}: {times[-1] - times[0]:.1f} s, {len(page) / 2**20:.1f} MiB')
    return 0


def _read(
    bag: Path, models: tuple[str, ...], start: float, duration: float
) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Times, s from the bag's first result, backbones and markers of each model; the stamps that all have."""
    from sesa2.bags.recording import open_recording

    found: dict[str, dict[int, np.ndarray]] = {}
    with open_recording(bag) as recording:
        names = {(m, kind): of_model(m, kind) for m in models for kind in ('shape', 'markers')}
        topics = {key: recording.find(name, TYPES[key[1]]) or '' for key, name in names.items()}
        missing = sorted(names[key] for key, topic in topics.items() if not topic)
        if missing:
            raise Sesa2Error(f'{bag}: no topic {missing[0]}; `sesa2 replay` computes the shape')
        wanted = set(topics.values())
        first = None
        for message in recording.messages(wanted):
            poses = (read_path if message.topic.endswith('/shape') else read_pose_array)(message.data)
            first = poses.stamp_ns if first is None else first
            t = (poses.stamp_ns - first) / NS
            if t >= start + duration:
                break
            if t >= start:
                found.setdefault(message.topic, {})[poses.stamp_ns] = poses.poses
    stamps = sorted(set.intersection(*(set(found.get(topic, ())) for topic in wanted)))
    if not stamps:
        raise Sesa2Error(f'{bag}: no result from {start:g} s on')
    arrays = {topic: np.stack([of[stamp] for stamp in stamps]) for topic, of in found.items()}
    times = (np.array(stamps) - stamps[0]) / NS
    return (
        times,
        {m: arrays[topics[m, 'shape']] for m in models},
        {m: arrays[topics[m, 'markers']] for m in models},
    )
