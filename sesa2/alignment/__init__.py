"""What is learnt about sensors once they are mounted: from a straight pose, from motion, and while the arm runs."""
