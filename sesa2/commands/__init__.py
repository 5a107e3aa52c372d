"""What `sesa2` can do, a file each: its arguments, and what it prints.

Heavy parts (ROS, matplotlib, PyElastica) are imported by the command that needs them, when it runs.
"""
