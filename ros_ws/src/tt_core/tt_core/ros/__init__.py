"""The only code that uses messages, parameters, quality of service and executors of ROS. All nodes share it."""
