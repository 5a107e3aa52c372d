"""What can be set of the tip controller."""

from dataclasses import dataclass

from sesa2.shape.options import parameter

LAWS = ('rates', 'paper')
ROUTES = ('direct', 'unbent')
OUTPUTS = ('joint_trajectory', 'float64_array')


@dataclass(frozen=True)
class ControllerOptions:
    """How the tip is driven; the defaults are those that worked on simulated arms of 20 cm."""

    model: str = parameter('pcc_delta', 'shape model whose tip is fed back')
    law: str = parameter(
        'rates', 'how the error becomes a motion: rates (resolved rates) or paper', choices=LAWS
    )
    route: str = parameter(
        'direct',
        'how the tip is led to a target: direct, or unbent (straighten, change the length, bend: racks slip less)',
        choices=ROUTES,
    )
    output: str = parameter(
        'joint_trajectory', 'type of `command`: a trajectory of one point, or bare numbers', choices=OUTPUTS
    )
    names: tuple[str, ...] = parameter(
        (), 'of the backbones that are driven, three a segment; left out: no controller'
    )
    rate: float = parameter(100.0, 'commands a second, Hz', low=1.0, high=1000.0)
    gain: float = parameter(
        2.5, "of what is left of the error, 1/s; the paper's law wants about 1.0", above=0.0, high=50.0
    )
    damping: float = parameter(0.01, 'of the inverse, m: larger is calmer near singular shapes', above=0.0)
    tip_speed: float = parameter(0.12, 'at which the tip is led to the target, m/s', above=0.0)
    length_rate: float = parameter(0.06, 'fastest that a backbone is driven, m/s', above=0.0)
    length_limits: tuple[float, ...] = parameter(
        (),
        'shortest and longest of a driven backbone, m a segment; left out: as segments.stretch and bend_max allow',
        above=0.0,
    )
    dead_band: float = parameter(0.003, 'error of the tip below which it is left alone, m', low=0.0)
    feedback_timeout: float = parameter(
        0.2, 'age at which tip and lengths are too old to steer by, s', above=0.0
    )
    on_fault: str = parameter('hold', 'what is done then: hold what is measured', choices=('hold',))
