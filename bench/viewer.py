"""A page open in a browser while eight IMUs stream: what the viewer costs, and whether its memory grows.

Three processes: `sesa2 run` with the virtual board and three models of 64 links, the viewer (this file run as a script,
which counts its frames), and a headless Chromium.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CHROMIUM = Path('/usr/bin/chromium')
WARM_UP_S = 15.0
SAMPLE_S = 1.0
# Software rendering of a small window: the browser is not what is measured.
FLAGS = (
    '--headless',
    '--no-sandbox',
    '--disable-gpu',
    '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader',
)
LARGE = 20_000  # bytes; three tubes have 37 000, a reading or a plot far less


def serve(out):
    """The viewer; once a second it notes frames drawn, processor time and memory."""
    from sesa2.nodes import viewer

    frames = 0
    draw = viewer.Viewer._draw

    def count(self):
        nonlocal frames
        frames += 1
        draw(self)

    viewer.Viewer._draw = count

    def note():
        page = resource.getpagesize() / 2**20
        with Path(out).open('w') as file:
            while True:
                resident = int(Path('/proc/self/statm').read_text().split()[1]) * page
                print(
                    json.dumps((time.monotonic(), frames, time.process_time(), resident)),
                    file=file,
                    flush=True,
                )
                time.sleep(SAMPLE_S)

    threading.Thread(target=note, daemon=True).start()
    return viewer.main()


def configuration():
    """The thesis's arm with three models of 64 links."""
    from sesa2.configuration import files

    c = files.load(ROOT / 'config/prototype3_8.yaml')
    return files.dump(
        replace(c, models=('pcc', 'pcc_exact', 'spline')).with_options('pcc', segments=(8,) * 8)
    )


def watch(playwright, address, seconds):
    """Look at the page; returns when it began, and the arrivals of frames at the browser since then."""
    browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS)
    page = browser.new_page(viewport={'width': 240, 'height': 160})
    arrived = []
    page.on('websocket', lambda s: s.on('framereceived', lambda f: len(f) > LARGE and arrived.append(len(f))))
    page.goto(address)
    page.get_by_text('streaming').wait_for(state='attached', timeout=60_000)
    page.wait_for_timeout(1e3 * WARM_UP_S)
    began = time.monotonic()
    arrived.clear()
    page.wait_for_timeout(1e3 * seconds)
    arrived = len(arrived)
    browser.close()
    return began, arrived


def rows(seconds=60.0):
    """(figure, value, unit, limit)."""
    if not CHROMIUM.exists():
        yield f'page open: not measured, no {CHROMIUM}', float('nan'), '', None
        return
    from playwright.sync_api import sync_playwright

    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        config, out = Path(folder) / 'arm.yaml', Path(folder) / 'out'
        config.write_text(configuration())
        page = subprocess.Popen(
            [sys.executable, __file__, out, '--ros-args', '-p', 'port:=0'], stdout=subprocess.PIPE
        )
        system = subprocess.Popen(
            [sys.executable, '-m', 'sesa2.cli', 'run', '--config', config, '--source', 'sim'],
            stdout=subprocess.DEVNULL,
        )
        try:
            address = page.stdout.readline().split()[-1].decode()
            began, arrived = watch(playwright, address, seconds)
        finally:
            for process in (system, page):
                process.terminate()
                process.communicate()
        noted = [json.loads(line) for line in out.read_text().splitlines()]
    noted = [row for row in noted if began <= row[0] <= began + seconds]
    first, last = noted[0], noted[-1]
    lasted, frames, busy, grown = (b - a for a, b in zip(first, last, strict=True))
    yield f'page open {seconds:.0f} s, three models of 64 links, frames drawn', frames / lasted, '/ s', None
    yield 'page open, frames at the browser (in software, on the same cores)', arrived / seconds, '/ s', None
    yield 'page open, processor time of the viewer', 100 * busy / lasted, '% of a core', 15
    yield 'page open, memory of the viewer at the end', last[3], 'MiB', None
    yield 'page open, memory gained meanwhile', grown, 'MiB', None


if __name__ == '__main__':
    raise SystemExit(serve(sys.argv[1]))
