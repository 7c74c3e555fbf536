"""Images recorded by other cameras and programs: videos, image folders, ROS 2 bags and MCAP topics."""
