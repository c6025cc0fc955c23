"""The ROS 2 gateway: values as topics, verbs as services, sticks and setpoints in; docs/ros.md."""
