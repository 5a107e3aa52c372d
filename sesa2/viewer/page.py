"""The page: the scene, and beside it the panel with its readings, its form and its buttons."""

import threading
import time
from collections.abc import Callable
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import viser

from sesa2.configuration import Configuration, files
from sesa2.configuration.chosen_files import ChosenFiles
from sesa2.errors import Sesa2Error
from sesa2.faults import fault_line
from sesa2.messages.colours import model_colours
from sesa2.partial_files import write_whole
from sesa2.viewer.fields import mistake_html
from sesa2.viewer.form import Form
from sesa2.viewer.live import Live
from sesa2.viewer.readings import calibration_html, complaints_html, rates_html, state_html
from sesa2.viewer.scene import Scene
from sesa2.viewer.steering import Steering
from sesa2.viewer.tip_panel import TipPanel
from sesa2.viewer.tip_plot import TipPlot

_READINGS_PERIOD_S = 0.5
_CHANGED = 'changed in the form; Start makes it work, the tab File saves it'
_PLOT_PERIOD_S = 0.2


class Page:
    """Everything that a browser shows.

    Parameters
    ----------
    server
        the page's.
    live
        what is known; somebody else fills it.
    steering
        what the buttons do.
    chosen
        which files may be chosen.
    """

    def __init__(self, server: viser.ViserServer, live: Live, steering: Steering, chosen: ChosenFiles):
        self._server, self._gui = server, server.gui
        self._chosen = chosen
        self._live, self._steering = live, steering
        self._busy = threading.Lock()
        self._readings_due = self._plot_due = 0.0
        self._in_force: Configuration | None = None
        self._gui.configure_theme(show_logo=False, show_share_button=False, control_width='large')
        self._gui.main_panel.dock_right()
        self.scene = Scene(server)
        self._add_controls()
        self._tip_panel = TipPanel(server, live, steering, self._do)
        tabs = self._gui.add_tab_group()
        with tabs.add_tab('View'):
            self._view = self._gui.add_folder('Models')
            self._boxes: list[Any] = []
            with self._gui.add_folder('Tip'):
                self._tip_of = self._gui.add_dropdown('model', ('–',))
                self._plot = TipPlot(self._gui)
            with self._gui.add_folder('Sensors'):
                self._rates = self._gui.add_html('')
        with tabs.add_tab('Calibration'):
            self._add_calibration()
        self._form = Form(self._gui, tabs, self._chosen.mistakes)
        self._form.changed = self._form_changed
        with tabs.add_tab('File'):
            self._add_file()

        @self._tip_of.on_update
        def _(_: Any) -> None:
            self._plot.clear()

    def configure(self, c: Configuration) -> None:
        """Show another arm from now on."""
        self.scene.configure(c)
        self._tip_panel.configure(c)
        for box in self._boxes:
            box.remove()
        self._boxes = []
        with self._view:
            for name, (r, g, b) in model_colours(c.models).items():
                self._boxes.append(
                    self._gui.add_html(
                        f'<div style="height:3px;margin:0.3em 0.8em 0;background:rgb({r},{g},{b})"></div>'
                    )
                )
                box = self._gui.add_checkbox(name, self.scene.shown[name])
                box.on_update(partial(self._show_model, name))
                self._boxes.append(box)
        self._tip_of.options = c.models
        self._plot.clear()

    def fill_in(self, c: Configuration) -> None:
        """Put a configuration into the form."""
        self._in_force = c
        self._chosen.allow(c)
        self._form.fill_in(c)
        self._tell_mistakes()

    def take_alignment(self, c: Configuration) -> None:
        """Put the mountings and headings of a configuration into the form, and leave the rest as it stands there."""
        self._in_force = c
        self._form.take_alignment(c)
        self._tell_mistakes()

    def draw(self) -> None:
        """Draw what is known now; to be called for every frame."""
        self._tip_panel.send()
        tip = self._live.backbones.get(self._tip_of.value)
        if tip is not None and len(tip):
            self._plot.add(tip[-1, :3])
        if not self._server.get_clients():
            return
        self.scene.draw(self._live)
        self._tip_panel.draw()
        now = time.monotonic()
        if now >= self._plot_due:
            self._plot_due = now + _PLOT_PERIOD_S
            self._plot.draw()
        if now >= self._readings_due:
            self._readings_due = now + _READINGS_PERIOD_S
            self._draw_readings()

    def _draw_readings(self) -> None:
        steerable = self._steering.available
        _set(self._state, 'content', state_html(self._live, steerable))
        _set(self._complaints, 'content', complaints_html(self._live))
        _set(self._rates, 'content', rates_html(self._live))
        _set(self._calibration, 'content', calibration_html(self._live))
        for buttons in (self._run_buttons, self._record_buttons):
            _set(buttons, 'visible', steerable)
        for action, button in self._calibration_buttons.items():
            _set(button, 'disabled', not self._steering.can(action))

    def _add_controls(self) -> None:
        self._state = self._gui.add_html('')
        self._run_buttons = self._gui.add_button_group(
            'System',
            ('Start', 'Stop'),
            visible=False,
            hint='Start makes what stands in the tabs Run, Arm and IMUs take effect; what runs is stopped first',
        )
        self._record_buttons = self._gui.add_button_group('Recording', ('Record', 'End'), visible=False)
        self._message = self._gui.add_html('')
        self._form_mistakes = self._gui.add_html('')
        self._complaints = self._gui.add_html('')

        @self._run_buttons.on_click
        def _(_: Any) -> None:
            if self._run_buttons.value == 'Start':
                self._do(lambda: self._steering.start(files.dump(self._checked())))
            else:
                self._do(lambda: self._steering.act('stop'))

        @self._record_buttons.on_click
        def _(_: Any) -> None:
            if self._record_buttons.value == 'Record':
                self._do(lambda: self._steering.record(files.dump(self._checked())))
            else:
                self._do(lambda: self._steering.act('stop_record'))

    def _add_calibration(self) -> None:
        self._calibration = self._gui.add_html('')
        labels = {
            'align': ('Align: the arm is straight now', 'learn how each IMU is tilted against the arm'),
            'align_headings': (
                'Align, headings too',
                'the arm is straight and stands or hangs: what turns an IMU about it is its heading',
            ),
            'read_offsets': ('Read the offsets of all chips', 'the chips stop measuring for a moment'),
            'save_calibration': ('Save the offsets', 'into the offsets file of the tab Run'),
        }
        self._calibration_buttons = {}
        for action, (label, hint) in labels.items():
            button = self._gui.add_button(label, hint=hint, disabled=True)
            button.on_click(partial(self._calibrate_when_clicked, action))
            self._calibration_buttons[action] = button

    def _show_model(self, name: str, event: Any) -> None:
        self.scene.show(name, event.target.value)

    def _calibrate_when_clicked(self, action: str, event: Any) -> None:
        del event
        self._do(lambda: self._calibrate(action))

    def _calibrate(self, action: str) -> str:
        told = self._steering.act(action)
        return f'{told}; the form has it, the tab File saves it' if action.startswith('align') else told

    def _add_file(self) -> None:
        path = self._gui.add_text('file', '', hint='on the computer that sesa2 runs on; or a shipped name')
        overwrite = self._gui.add_checkbox('overwrite', False, hint='save over a file that is there')
        buttons = self._gui.add_button_group('Configuration', ('Load', 'Save'))

        @buttons.on_click
        def _(_: Any) -> None:
            if buttons.value == 'Load':
                self._do(lambda: self._load(path.value))
            else:
                self._do(lambda: self._save(path.value, overwrite.value))

    def _do(self, action: Callable[[], str], at_once: bool = False) -> None:
        """Do what a button says and tell how it went; one thing at a time, but for what must not wait."""
        free = self._busy.acquire(blocking=False)
        if not (free or at_once):
            self._tell('still busy with what was asked before', bad=True)
            return
        try:
            self._tell('…')
            self._tell(action() or 'done')
        except Sesa2Error as error:
            self._tell(str(error), bad=True)
        except Exception as error:
            self._tell(fault_line(error), bad=True)
        finally:
            if free:
                self._busy.release()

    def _checked(self) -> Configuration:
        c = self._form.check()
        if c is None:
            self._tell_mistakes()
            raise Sesa2Error('not done, since the form has mistakes')
        return c

    def _load(self, name: str) -> str:
        if not name.strip():
            raise Sesa2Error('no file is named, expected a path or the name of a shipped configuration')
        if name.strip() not in files.shipped():
            self._chosen.check(name.strip())
        self._form.fill_in(files.load(files.find(name.strip())))
        self._tell_mistakes()
        return f'{name} is in the form; Start makes it work'

    def _save(self, name: str, overwrite: bool) -> str:
        if not name.strip():
            raise Sesa2Error('no file is named, expected a path to save to')
        path = Path(name.strip()).expanduser()
        self._chosen.check(path)
        if path.suffix not in ('.yaml', '.yml'):
            raise Sesa2Error(f'{path}: expected a file name that ends in .yaml')
        text = files.dump(self._checked())
        try:
            write_whole(path, text, overwrite=overwrite)
        except FileExistsError:
            raise Sesa2Error(f'{path} exists; tick overwrite, or choose another name') from None
        except OSError as error:
            raise Sesa2Error(f'{path} cannot be written: {error.strerror}') from None
        return f'saved in {path.resolve()}'

    def _form_changed(self) -> None:
        self._tell_mistakes()
        # What was said of the form before no longer holds.
        if not self._busy.locked() and self._form.configuration != self._in_force:
            self._tell(_CHANGED if self._steering.available else '')

    def _mistakes(self) -> str:
        return '\n'.join(f'{m.place}: {m.message}' for m in self._form.mistakes)

    def _tell_mistakes(self) -> None:
        lines = self._mistakes().splitlines()
        _set(self._form_mistakes, 'content', mistake_html(lines) if lines else '')

    def _tell(self, text: str, bad: bool = False) -> None:
        lines = text.splitlines()
        good = f'<div style="font-size:0.85em;padding:0 0.8em">{"<br>".join(map(escape, lines))}</div>'
        _set(self._message, 'content', (mistake_html(lines) if bad else good) if lines else '')


def _set(handle: Any, name: str, value: Any) -> None:
    """Only what changed is sent to the browsers."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)
