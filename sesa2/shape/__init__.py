"""Shape of the arm from orientations: arrays in, arrays out, numpy only."""
