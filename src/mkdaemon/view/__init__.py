"""What people look at: pages and screens made of values from the bus or of a recording. Stands on the client."""
