"""What the nodes need of ROS: parameters, qualities of service, diagnostics, spinning, and listening to the graph."""
