"""Stand-ins for ros2cli, launch and rosbag2 on machines without ROS: a ros2 command, a launch runner, a recorder and a player."""
