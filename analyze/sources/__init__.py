"""Frames that other cameras and programs recorded: videos, image folders, ROS bags and MCAP topics."""
