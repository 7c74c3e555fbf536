"""Export of an estimated body as URDF, SDF, MJCF, USD, ROS message or Gazebo model; Foxglove layouts."""
