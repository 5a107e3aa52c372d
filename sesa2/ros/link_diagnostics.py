"""What /diagnostics says of a board's link and of the IMUs on it."""

from typing import Any

from sesa2.link.board_link import BoardLink
from sesa2.link.packets import State
from sesa2.link.session import outdated_firmware
from sesa2.link.status import Counters, ImuStatus, OffsetsState
from sesa2.messages.topic_names import imu_name
from sesa2.ros.confined_node import ConfinedNode
from sesa2.ros.diagnostics import ERROR, OK, WARN, Diagnostics, Part


class LinkDiagnostics:
    """Publishes, once a second, how a link and its IMUs are.

    Parameters
    ----------
    node
        whose link it is.
    link
        the link.
    name
        of the link as a part of the node.
    """

    def __init__(self, node: ConfinedNode, link: BoardLink, name: str):
        self._link, self._name = link, name
        self._shown = Counters()
        self._diagnostics = Diagnostics(node, link.settings.port, self._report)

    def publish(self) -> None:
        """Publish now."""
        self._diagnostics.publish()

    def _report(self) -> list[Part]:
        imus = self._link.session.imus()
        return [self._report_link()] + [self._report_imu(i, imus.get(i)) for i in self._link.settings.ids]

    def _report_link(self) -> Part:
        session = self._link.session
        counters, before = session.counters(), self._shown
        self._shown = counters
        rate = counters.sweeps - before.sweeps
        damaged = counters.frame_errors.total - before.frame_errors.total
        lost = counters.lost_sweeps - before.lost_sweeps
        values: dict[str, Any] = {k: v for k, v in vars(counters).items() if k != 'frame_errors'}
        values |= {f'frame_errors_{k}': v for k, v in counters.frame_errors._asdict().items()}
        hello = session.hello
        if hello:
            values['firmware'] = hello.firmware
        if stats := session.stats:
            values |= {f'board_{k}': v for k, v in stats._asdict().items()}
        level, text = OK, f'{rate} sweeps in the last second'
        if self._link.failure:
            level, text = ERROR, str(self._link.failure)
        elif not session.connected:
            level, text = ERROR, 'no board streams on this port; trying again'
        elif lost or damaged:
            level, text = WARN, f'{text}, {lost} lost, {damaged} frames damaged'
        elif hello and hello.outdated:
            level, text = WARN, f'{text}; {outdated_firmware(hello)}'
        return self._name, level, text, values

    def _report_imu(self, imu: int, status: ImuStatus | None) -> Part:
        if status is None:
            return imu_name(imu), ERROR, 'not heard yet', {}
        scores, fusion = status.scores, self._link.settings.fusion.name
        values: dict[str, Any] = {'state': status.state.name, 'errors': status.errors}
        if scores:
            values |= scores._asdict()
        values['offsets'] = status.offsets.value
        if not self._link.session.connected:
            return imu_name(imu), ERROR, 'is on a board that does not stream', values
        if status.state is State.ABSENT:
            return imu_name(imu), ERROR, 'does not answer: cable, power, multiplexer channel', values
        if status.state is not State.RUN:
            return imu_name(imu), WARN, 'starts', values
        if status.offsets is OffsetsState.DIFFERENT:
            return imu_name(imu), ERROR, 'works with other offsets than those saved', values
        if scores is None:
            return imu_name(imu), OK, 'measures without fusion', values
        if fusion != 'IMU' and scores.mag == 0:
            return imu_name(imu), WARN, 'magnetometer not calibrated: its heading means nothing', values
        return imu_name(imu), OK, scores.next_step(fusion), values
