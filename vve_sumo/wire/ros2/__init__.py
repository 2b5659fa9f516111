"""ROS 2's view of a drive: message types, and what of our values stands in which field; no ROS is needed."""
