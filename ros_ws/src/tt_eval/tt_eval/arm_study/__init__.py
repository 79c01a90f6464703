"""Study of an arm, whether it can play and where it should stand: the command `ros2 run tt_eval arm`."""
