"""The page in the browser: the arm in 3D, its readings, and the panel that steers. Knows viser, and nothing of ROS."""
