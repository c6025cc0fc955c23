"""From tags to the pose of a target: fits, gates, ambiguity, covariance."""
