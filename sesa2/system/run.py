"""What `sesa2 run` does: start the system, keep it going, end it."""

import gc
import json
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from sesa2.configuration import Configuration
from sesa2.configuration.chosen_files import ChosenFiles
from sesa2.errors import Sesa2Error
from sesa2.ros.lifeline import Lifeline
from sesa2.ros.spinning import Spinner, ros_context
from sesa2.system.remote_control import RemoteControl
from sesa2.system.terminal import Terminal
from sesa2.system.wiring import System
from sesa2.viewer.web_port import LOOPBACK, check_port

# The link's thread and the executor take turns: Python's 5 ms would be as long as a result may take.
_SWITCH_S = 0.0005
_VIEWER_PATIENCE_S = 5.0


def run(
    configuration: Configuration,
    stop: threading.Event,
    duration: float | None = None,
    *,
    viewer_port: int | None = None,
    namespace: str = '',
    origin: Path | None = None,
    folder: Path | None = None,
) -> None:
    """Run until asked to stop, the end of the bag or the given time.

    Parameters
    ----------
    configuration
        says by its source, mode and files which nodes are wanted.
    stop
        set from outside, to end.
    duration
        s; None: no end.
    viewer_port
        show a page with a control panel on this port, 0: any that is free; then a failure of the system does not end
        the run, since it can be mended there.
    namespace
        of all nodes.
    origin
        the file that the configuration came from, if there is one.
    folder
        under which files may be chosen on the page; the present one where it is None.

    Raises
    ------
    Sesa2Error
        a node cannot start, or cannot go on; the page cannot be shown; or, at the end, something was lost on the way.
    """
    if viewer_port:
        check_port(LOOPBACK, viewer_port)
    ends = time.monotonic() + duration if duration else float('inf')
    sys.setswitchinterval(_SWITCH_S)
    with ros_context([]), Spinner() as spinner, ExitStack() as stack:
        system = System(spinner, namespace, origin, viewer_port is not None)
        stack.callback(system.end)
        system.check_claims(configuration)
        if viewer_port is None:
            system.start(configuration)
            _spin(spinner, system, lambda: stop.is_set() or system.finished or time.monotonic() > ends)
            if system.failure:
                raise system.failure
        else:
            chosen = ChosenFiles(folder or Path.cwd())
            node = RemoteControl(system, configuration, chosen)
            spinner.add(node)
            viewer = stack.enter_context(_Viewer(viewer_port, node.get_namespace(), chosen.folder))
            node.try_to_start()

            def ended() -> bool:
                if stop.is_set() or time.monotonic() > ends:
                    return True
                node.look_after()
                viewer.look_after()
                return False

            _spin(spinner, system, ended)
        unheard = system.unheard  # as long as there is somebody to ask
        system.stop()
        if wrong := [*dict.fromkeys(map(str, system.lost)), *filter(None, [unheard])]:
            raise Sesa2Error('; '.join(wrong))


def _spin(spinner: Spinner, system: System, ended: Callable[[], bool]) -> None:
    """Spin until ended, with a line a second on the terminal about what runs."""
    # What has been loaded stays: the collector of garbage need not go through it again and again while sweeps wait.
    gc.collect()
    gc.freeze()
    terminal = Terminal(system)
    n_told = 0
    while not ended():
        spinner.spin_once()
        system.check_claims()
        system.end_failed()
        for error in system.lost[n_told:]:
            print(f'error: {error}; the others go on', file=sys.stderr)
        n_told = len(system.lost)
        terminal.show_when_due()
    if not system.failure:
        terminal.show_summary()


class _Viewer:
    """The viewer, in a process of its own so that drawing never holds up a sweep; a context manager that ends it."""

    def __init__(self, port: int, namespace: str, folder: Path):
        arguments = ['-m', 'sesa2.nodes.viewer', '--ros-args', '-p', f'port:={port}']
        if namespace != '/':
            arguments += ['-r', f'__ns:={namespace}']
        self._again = ' '.join(['python', *arguments])
        self._told = False
        self._lifeline = Lifeline()
        command = [sys.executable, *arguments, '-p', f'files:={json.dumps(str(folder))}']
        # Ctrl-C reaches it too, also while it loads its libraries; it is ended from here.
        self._process = subprocess.Popen(
            command,
            preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_IGN),
            pass_fds=(self._lifeline.descriptor,),
            env=self._lifeline.environment,
        )
        self._lifeline.let_go()

    def look_after(self) -> None:
        """Without a page from the beginning there is no use in going on; a page that is lost later must stop nothing.

        Raises
        ------
        Sesa2Error
            it could not start.
        """
        started = self._lifeline.started
        if self._told or self._process.poll() is None:
            return
        self._told = True
        if not (started or self._lifeline.started):
            raise Sesa2Error('the page could not be shown')
        print(f'the viewer has ended, the system goes on; `{self._again}` shows it again', file=sys.stderr)

    def __enter__(self) -> '_Viewer':
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(_VIEWER_PATIENCE_S)
        except subprocess.TimeoutExpired:  # it hangs, or was stopped: then it hears only this
            self._process.kill()
            self._process.wait()
        self._lifeline.close()
