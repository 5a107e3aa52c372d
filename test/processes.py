"""Programs of the package as processes of their own, ended whatever happens."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import sesa2

REPOSITORY = Path(sesa2.__file__).resolve().parents[1]
# Long enough for a slow machine; reached only by a test that fails.
PATIENCE_S = 60.0


class Program:
    """A running program, whose output goes to files so that no full pipe halts it. A context manager.

    Parameters
    ----------
    arguments
        what follows `python`.
    folder
        where it works and where its output is kept.
    options
        of subprocess.Popen.
    """

    _count = 0

    def __init__(self, arguments, folder, **options):
        Program._count += 1
        self._files = [folder / f'.{Program._count}.{name}' for name in ('out', 'err')]
        out, err = (file.open('wb') for file in self._files)
        with out, err:
            self._process = subprocess.Popen(
                [sys.executable, *map(str, arguments)],
                stdout=out,
                stderr=err,
                cwd=folder,
                # Of the package that is tested, whatever is installed.
                env={**os.environ, 'PYTHONPATH': str(REPOSITORY), 'ROS_LOG_DIR': str(folder)},
                **options,
            )

    @property
    def output(self):
        return self._files[0].read_text()

    @property
    def errors(self):
        return self._files[1].read_text()

    @property
    def pid(self):
        return self._process.pid

    @property
    def running(self):
        return self._process.poll() is None

    def signal(self, number):
        self._process.send_signal(number)

    def until(self, condition, what):
        """Wait until a condition holds; that the program ends instead is an error."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert self.running, f'ended before {what}: {self.errors}'
            assert time.monotonic() < deadline, f'waited in vain: {what}\n{self.output}\n{self.errors}'
            time.sleep(0.02)

    def ended(self):
        """Wait until it has ended; its exit code."""
        try:
            return self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            raise AssertionError(f'hangs\n{self.output}\n{self.errors}') from None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self.running:
            self._process.send_signal(signal.SIGKILL)
        self._process.wait()


def node(name, folder, *arguments, **options):
    """A node on its own."""
    return Program(['-m', f'sesa2.nodes.{name}', *arguments], folder, **options)


def command(folder, *arguments, **options):
    """The entry point `sesa2`."""
    return Program(['-m', 'sesa2.cli', *arguments], folder, **options)


def failed_clearly(program, *expected):
    """Whether it ended with exit code 1 and a message that names all this, without a traceback."""
    code, errors = program.ended(), program.errors
    assert code == 1, f'exit code {code}, {errors}'
    assert 'Traceback' not in errors
    assert 'error: ' in errors
    for text in expected:
        assert text in errors, errors
    return True
