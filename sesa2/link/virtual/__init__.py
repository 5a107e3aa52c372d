"""A virtual board: speaks the whole protocol on a pseudo-terminal, and knows the truth that it plays."""
