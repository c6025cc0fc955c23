"""mkdaemon: the programs on the vehicle's side."""
