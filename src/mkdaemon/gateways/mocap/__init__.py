"""Gateway to motion capture systems, through the library `motioncapture`."""
