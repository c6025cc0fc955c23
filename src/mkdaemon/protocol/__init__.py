"""The MikroKopter serial protocol, pure: framing, wire fields, messages, dialects, settings."""
