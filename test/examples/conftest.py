"""The fixtures of all tests that need a ROS graph."""

from graph_fixtures import boards, configured, graph, ros_graph  # noqa: F401
