"""A simulated arm that racks drive: it grows and bends, slips, sags and is measured; no ROS, no clock."""
