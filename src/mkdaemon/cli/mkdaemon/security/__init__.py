"""`mkdaemon security`: certificates and access rules for daemons and clients of other machines."""
