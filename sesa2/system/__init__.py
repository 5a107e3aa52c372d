"""What `sesa2 run` is: the nodes that a configuration asks for, wired, kept going, shown and steered."""
