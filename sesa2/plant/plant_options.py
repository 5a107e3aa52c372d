"""What can be set of the simulated arm, and two set-ups whose error is known."""

from dataclasses import dataclass

from sesa2.shape.options import parameter

Floats = tuple[float, ...]


@dataclass(frozen=True)
class PlantOptions:
    """How the simulated arm is driven, and what it gets wrong; every arm's own share is drawn from the seed."""

    slip: float = parameter(
        0.5,
        "share of a rack's motion that is lost where the arm is much bent; 0.5 mild, 0.85 heavy",
        low=0.0,
        high=0.9,
    )
    slip_bend: float = parameter(0.2, 'bend at which 63 % of that is reached, rad', above=0.0)
    slip_reach: float = parameter(0.08, 'furthest that a rack can slip altogether, m', above=0.0)
    slip_spread: float = parameter(
        0.15, 'by what share of it the slip differs from rack to rack', low=0.0, high=0.5
    )
    affine: float = parameter(
        0.33,
        'how much more the base of a segment is curved than its middle, as a share; the tip as much less',
        low=-1.0,
        high=1.0,
    )
    affine_spread: float = parameter(
        0.14, 'by how much that differs from segment to segment', low=0.0, high=0.5
    )
    hollow: float = parameter(
        0.1, 'how much more both ends of a segment are curved than on average, as a share', low=-0.5, high=0.5
    )
    sag: float = parameter(
        0.1,
        'how far the weight of the arm, straight, horizontal and at rest, turns its tip, rad',
        low=0.0,
        high=1.0,
    )
    push: Floats = parameter((0.0, 0.0), 'bend by which somebody pushes the arm, x and y, rad')
    lag: float = parameter(0.15, 'time in which a motor makes 63 % of a step, s', low=0.0)
    rate: float = parameter(0.1, 'fastest that a motor moves its rack, m/s', above=0.0)
    home: Floats = parameter(
        (), 'length of each segment at the start, m, one for all or one each; left out: as at rest', above=0.0
    )
    travel: Floats = parameter(
        (),
        'shortest and longest of a rack for each segment that it passes, m; left out: 0.3 and 2.2 of that at rest',
        above=0.0,
    )
    encoder_step: float = parameter(
        1e-4, "what one count of a rack's encoder stands for, m; 0: no steps", low=0.0
    )
    length_noise: float = parameter(5e-4, 'error of a length that is measured on the axis, m', low=0.0)
    mounting_twist: float = parameter(
        0.07, 'error with which IMUs are mounted about the axis of the arm, rad, besides all others', low=0.0
    )
    imu_errors: float = parameter(1.0, "angles by which the IMUs err over a BNO055's; 0: none", low=0.0)
    seed: int = parameter(0, 'of which arm and which errors', low=0)


# Driven open loop to random targets at 13 to 24 cm, bent by up to 75°, these miss by about 2.3 and 4.0 cm.
MILD = PlantOptions()
HEAVY = PlantOptions(slip=0.85, imu_errors=3.0)
