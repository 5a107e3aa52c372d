"""What a sensor says of a shape, and how it errs: a folder for each kind."""
