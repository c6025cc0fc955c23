"""The flying aircraft: airframe, loops, sensors, wind, pilot."""
