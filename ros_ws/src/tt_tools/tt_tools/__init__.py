"""What the wheels lack of ros2cli, launch and rosbag2: the ros2 command, launch runner, recorder and player."""
