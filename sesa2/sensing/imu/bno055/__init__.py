"""What is particular to the BNO055: its calibration scores, its offsets and their file."""
