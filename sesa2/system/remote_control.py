"""The node `system`: lets a control panel start and stop what `sesa2 run` runs."""

from collections.abc import Callable

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from sesa2.configuration import Configuration, ConfigurationError, files
from sesa2.configuration.chosen_files import ChosenFiles
from sesa2.errors import Sesa2Error
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Part
from sesa2.system.wiring import System


class RemoteControl(ConfinedNode):
    """Takes a configuration as a parameter, and starts, stops and records on request.

    Parameters
    ----------
    system
        what is steered.
    configuration
        in force now; the files that it names may be anywhere.
    chosen
        which other files may be chosen.

    Attributes
    ----------
    trouble
        why nothing runs; empty while all is well.
    """

    GOES_ON = True

    def __init__(self, system: System, configuration: Configuration, chosen: ChosenFiles):
        super().__init__('system', namespace=system.namespace, use_global_arguments=False)
        self._chosen = chosen
        self._chosen.allow(configuration)
        self._system = system
        self._configuration = configuration
        self._alignment: Configuration | None = None
        self.trouble = ''
        self.declare_parameter(
            'configuration',
            files.dump(configuration),
            ParameterDescriptor(description='the configuration as YAML; takes effect at the next ~/start'),
        )
        self.add_on_set_parameters_callback(self._set)
        for name, action in (
            ('start', self._start),
            ('stop', self._stop),
            ('record', self._record),
            ('stop_record', self._stop_recording),
        ):
            self.create_service(Trigger, f'~/{name}', self._answer(action))
        self._diagnostics = Diagnostics(self, 'sesa2', self._report)

    def try_to_start(self) -> None:
        """Start with the configuration in force; a failure is shown, not raised."""
        try:
            self._system.start(self._configuration)
        except Sesa2Error as error:
            self._give_up(error)

    def look_after(self) -> None:
        """A node that fails stops the others, and the reason is shown; so does a bag that has been played.

        What `~/align` of the estimator has found is kept for the next start.
        """
        estimator = self._system.estimator
        if estimator and estimator.aligned and estimator.aligned is not self._alignment:
            self._alignment = estimator.aligned
            self._keep(estimator.aligned)
        if failure := self._system.failure:
            self._give_up(failure)
        elif self._system.finished:
            self._system.stop()

    def _keep(self, aligned: Configuration) -> None:
        if aligned.imus.ids == self._configuration.imus.ids:  # else the next start is for another arm
            c = self._configuration.with_alignment(aligned.mountings, aligned.headings)
            self.set_parameters([Parameter('configuration', value=files.dump(c))])

    def _give_up(self, error: Sesa2Error) -> None:
        self._system.stop()
        self.trouble = str(error)
        self.get_logger().error(self.trouble)

    def _set(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name == 'configuration':
                try:
                    c = files.parse(str(parameter.value), 'parameter configuration')
                    if refused := self._chosen.mistakes(c):
                        raise ConfigurationError(refused, 'parameter configuration')
                except Sesa2Error as error:
                    return SetParametersResult(successful=False, reason=str(error))
                self._configuration = c
        return SetParametersResult(successful=True)

    def _answer(
        self, action: Callable[[], str]
    ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            del request
            try:
                response.message, response.success = action(), True
            except Sesa2Error as error:
                response.message, response.success = str(error), False
            return response

        return answer

    def _start(self) -> str:
        self._system.stop()
        self.trouble = ''
        self._system.start(self._configuration)
        self._system.wait_until_it_runs()
        recorder = self._system.recorder
        recording = f'; recording into {recorder.path}, since the form names a bag' if recorder else ''
        run = self._configuration.run
        return f'started: source {run.source}, mode {run.mode}{recording}'

    def _stop(self) -> str:
        before = len(self._system.lost)
        self._system.stop()
        self.trouble = ''
        if lost := self._system.lost[before:]:
            raise Sesa2Error(f'stopped, but {"; ".join(map(str, lost))}')
        return 'stopped'

    def _record(self) -> str:
        return f'recording into {self._system.record(self._configuration.record.file)}'

    def _stop_recording(self) -> str:
        return f'recorded {self._system.stop_recording()}'

    def _report(self) -> list[Part]:
        if self.trouble:
            return [('run', ERROR, self.trouble, {})]
        if not self._system.nodes:
            return [('run', WARN, 'stopped', {})]
        recorder = self._system.recorder
        recording = str(recorder.path) if recorder else ''
        level, text = (WARN, f'running; {self._system.lost[-1]}') if self._system.lost else (OK, 'running')
        return [('run', level, text, {'source': self._configuration.run.source, 'recording': recording})]
