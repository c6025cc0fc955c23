"""`mkctl view`: what it costs a daemon."""
