"""The board link: packets, serial port, board clock and a virtual board."""
