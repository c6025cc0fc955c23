"""`mkctl view`: what it costs a daemon, and its picture for the documentation."""
