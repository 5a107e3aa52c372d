"""From single samples to sweeps, and from sweeps to the arm's shape by every model: the same live and offline."""
