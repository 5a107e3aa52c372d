"""The tip of an arm driven to a target by feedback of its shape; no ROS."""

from sesa2.control.tip_controller import ControlState, TipController

__all__ = ['ControlState', 'TipController']
