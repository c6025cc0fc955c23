"""MAVLink 2: QGroundControl, MAVSDK and MAVProxy meet a MikroKopter; docs/mavlink.md."""
