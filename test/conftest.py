"""Every test process has a ROS graph of its own, on this host only."""

import os

# Below 102 a domain's ports stay clear of those that Linux gives out by itself.
os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# Shared memory would be left behind by a test that kills a node.
os.environ['FASTDDS_BUILTIN_TRANSPORTS'] = 'UDPv4'
