"""The BNO055: its offsets and their file, its mounting, its errors."""
