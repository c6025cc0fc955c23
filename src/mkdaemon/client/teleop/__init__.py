"""What an operator's hands ask for, pure: raw axes and buttons with their times in, setpoints or a release out.

It knows no device, no clock and no bus. Flight code never imports it: it runs in the client, `mkctl teleop`.
"""
