"""Files of strangers, given to every command that reads one."""
