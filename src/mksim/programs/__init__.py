"""`mkdaemon sim` and `mkdaemon demo`: programs on top of daemon and client, found by entry points."""
