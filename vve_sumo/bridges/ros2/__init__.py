"""ROS 2: a drive's wires as topics, and velocity commands as setpoints; over DDS, without an installation of ROS."""
