"""`sesa2 align --truth`: what known points tell about the sensors of an arm."""

import argparse

from sesa2.commands.arguments import load_config, warn
from sesa2.configuration import files
from sesa2.configuration.description import table
from sesa2.errors import Sesa2Error
from sesa2.partial_files import write_whole
from sesa2.time import NS


def align_points(options: argparse.Namespace) -> int:
    """Learn, report, write."""
    from sesa2.bags.recorded_sweeps import read_sweeps
    from sesa2.bags.sensor_logs import assign_logs
    from sesa2.evaluation.bag_evaluation import in_one_frame
    from sesa2.evaluation.known_points import learn_from_points
    from sesa2.evaluation.registration import TURNING
    from sesa2.evaluation.truth import read_truth

    c = load_config(options)
    if options.out.exists():
        raise Sesa2Error(f'{options.out}: exists already, expected the name of a new configuration')
    if not c.markers.names:
        raise Sesa2Error(f'{options.config}: has no markers, expected those whose positions are known')
    if unknown := [name for name in options.models or () if name not in c.models]:
        raise Sesa2Error(f'no model {unknown[0]} in {options.config}; there are {", ".join(c.models)}')
    read = read_truth(
        options.truth,
        c.markers.names,
        topic=options.truth_topic,
        given=dict(options.markers),
        rate=options.truth_rate,
    )
    truth, about_frames = in_one_frame(read.trajectory, read.frame, c, c.frame_id, options.register)
    axes = [read.axes] if read.axes and options.register not in TURNING else []
    sweeps = read_sweeps(assign_logs(options.source, c.imus.all_ids), c, options.first_id)
    warn([*read.notes, *about_frames, *axes, *sweeps.problems])
    t = (sweeps.stamps_ns - sweeps.stamps_ns[0]) / NS
    sweeps = sweeps.chosen((t >= options.start) & (t < options.start + options.duration))
    if not len(sweeps.stamps_ns):
        raise Sesa2Error(
            f'{" ".join(options.source)}: no sweep from {options.start:g} s on; the recording has {t[-1]:.1f} s'
        )
    learnt = learn_from_points(
        c,
        sweeps,
        truth,
        models=options.models,
        register=options.register,
        time_offset=options.time_offset,
    )
    warn([*learnt.notes, *learnt.doubts])
    head = (
        f'{learnt.points} points at {learnt.instants} instants; by {learnt.model}, median distance '
        f'{1e3 * learnt.before:.1f} mm before, {1e3 * learnt.after:.1f} mm after; time offset '
        f'{learnt.time_offset:+.4f} s'
    )
    rows = [
        (
            u.name,
            f'{u.signed(v)} ± {u.told(s)} {u.unit}'.rstrip(),
            f'± {u.told(u.expected)} {u.unit}'.rstrip(),
            u.key,
        )
        for u, v, s in learnt.told
    ]
    lines = [head, *table(('learnt', 'corrected by', 'expected', 'key'), rows)]
    if learnt.untold:
        lines.append('not told by the points, left as it was (what is left of what was expected):')
        lines += table(
            ('', 'left', 'expected'),
            [
                (u.name, f'± {u.told(s)} {u.unit}'.rstrip(), f'± {u.told(u.expected)}')
                for u, s in learnt.untold
            ],
        )
    print('\n'.join(line.rstrip() for line in lines))
    learnt_from = f'# Learnt by sesa2 align --truth from {options.truth.name}:'
    comments = '\n'.join([learnt_from, *(f'# {line}'.rstrip() for line in lines)])
    try:
        write_whole(options.out, f'{comments}\n{files.dump(learnt.configuration)}')
    except OSError as error:
        raise Sesa2Error(f'{options.out}: cannot be written: {error.strerror}') from None
    print(f'written to {options.out}')
    return 0
