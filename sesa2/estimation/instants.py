"""Which of the samples that wait were measured at the same instant."""

from collections.abc import Sequence

from sesa2.estimation.imu_queue import ImuQueue

# Stamp of the first waiting sample of an IMU, ns, and the IMU's index.
Member = tuple[int, int]


def present(members: list[Member], imus: Sequence[ImuQueue], timeout_ns: int) -> list[Member]:
    """Those that measured at the time of the oldest sample; of the others only later ones wait."""
    oldest = min(members)[0]
    if max(members)[0] - oldest > timeout_ns:
        members = [m for m in members if m[0] - oldest <= timeout_ns]
    # An IMU that comes back from its silence does not belong to the rounds before.
    next_ns = min(members)[0] + _period(members, imus)
    return [m for m in members if m[0] < next_ns or not comes_back(m, members, imus, timeout_ns)]


def _period(members: list[Member], imus: Sequence[ImuQueue]) -> int:
    """Time of a round, as those tell it who were in the last one; 0 where none was."""
    return min(
        (stamp - imus[index].used_ns for stamp, index in members if imus[index].used),
        default=0,
    )


def comes_back(member: Member, members: list[Member], imus: Sequence[ImuQueue], timeout_ns: int) -> bool:
    """Whether this is an IMU's first sample after a silence in which others went on."""
    imu = imus[member[1]]
    silence = member[0] - imu.used_ns
    return imu.used is not None and silence > timeout_ns + _period(members, imus)


def went_on(members: list[Member], imus: Sequence[ImuQueue], timeout_ns: int) -> bool | None:
    """Whether any of these measured again soon; None where that is not known of all of them yet."""
    soon_ns = timeout_ns + _period(members, imus)
    queues = [(stamp, imus[index].waiting) for stamp, index in members]
    following = [(stamp, queue[1].stamp_ns) for stamp, queue in queues if len(queue) > 1]
    if any(later - stamp <= soon_ns for stamp, later in following):
        return True
    return False if len(following) == len(members) else None


def catch_up(members: list[Member], imus: Sequence[ImuQueue]) -> list[Member]:
    """Pass over samples of faster IMUs that are older than need be; (stamp, index) of the first waiting ones."""
    newest = max(members)[0]
    out = []
    for _, index in members:
        imu = imus[index]
        while len(imu.waiting) > 1 and imu.waiting[1].stamp_ns <= newest:
            imu.use()
        out.append((imu.waiting[0].stamp_ns, index))
    return out


def left_over(members: list[Member], imus: Sequence[ImuQueue]) -> list[Member]:
    """Members whose sample is the end of the sweep before.

    After a lost sample, or when listening began in the middle, a full set may begin with the end of one sweep and
    end with the beginning of the next. Then its largest gap is much longer than the pause before the next round
    would be; the samples before the gap are let go, and the set is completed by those that follow.
    """
    members = sorted(members)
    span = members[-1][0] - members[0][0]
    periods = [stamp - imus[index].used_ns for stamp, index in members if imus[index].used is not None]
    if not periods or 2 * span <= min(periods):
        return []
    gap, cut = max((members[k + 1][0] - members[k][0], k + 1) for k in range(len(members) - 1))
    pause = min(periods) - span
    if gap <= 2 * pause or 2.5 * gap <= min(periods):
        return []
    return members[:cut]
