"""The tip of an arm driven to a target by feedback of its shape; no ROS."""

from sesa2.control.tip_controller import State, TipController

__all__ = ['State', 'TipController']
