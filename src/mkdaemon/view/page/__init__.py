"""`mkctl view`: the aircraft in a browser, live or played from a recording."""
