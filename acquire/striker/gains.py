"""Gains of the servo's position control: weaker motors get the stiffness and damping of an XM430-W210."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquire.striker.sample import TICK_RAD

if TYPE_CHECKING:
    from schemas.servo_models import ServoModel

POSITION_P_GAIN = 1600
"""twice the default, for a servo of POSITION_TORQUE_N_M: the arm's weight then shifts it by 2 ticks, and it
follows a swing within 10 ms"""
POSITION_TORQUE_N_M = 3.0
"""stall torque for which POSITION_P_GAIN is meant [N m]; a weaker servo gets a larger gain"""
DAMPING_N_M_S = 0.25
"""damping of the arm's motion by back EMF and derivative gain together [N m s/rad]; that of an XM430-W210 by
its back EMF alone is larger"""
DERIVATIVE_UNIT_S = 1e-3 / 16 / TICK_RAD / 885
"""duty per unit of Position D Gain and of speed [s/rad] (e-manual: gain / 16, per control period of 1 ms)"""
MOST_GAIN = 16383
"""largest value of a gain's register"""
DAMPING_D_GAIN = 4000
"""gain of a stopped arm without a position goal: the remaining speed is lost in some 5 ms, and nothing pulls
it back"""


def position_gains(model: ServoModel) -> tuple[int, int]:
    """Proportional and derivative gain with which the servo holds a position.

    What a weaker motor lacks in damping by its own back EMF, the derivative gain supplies.

    Args:
        model: the servo's model.
    """
    back_emf = model.stall_torque_n_m / model.no_load_rad_s
    damping = max(0.0, DAMPING_N_M_S - back_emf) / (DERIVATIVE_UNIT_S * model.stall_torque_n_m)
    return _stronger(POSITION_P_GAIN, model), min(MOST_GAIN, round(damping))


def damping_gain(model: ServoModel) -> int:
    """Derivative gain of a stopped arm without a position goal.

    Args:
        model: the servo's model.
    """
    return _stronger(DAMPING_D_GAIN, model)


def _stronger(gain: int, model: ServoModel) -> int:
    """Gain that gives this motor the torque which `gain` gives one of POSITION_TORQUE_N_M."""
    return min(MOST_GAIN, round(gain * max(1.0, POSITION_TORQUE_N_M / model.stall_torque_n_m)))
