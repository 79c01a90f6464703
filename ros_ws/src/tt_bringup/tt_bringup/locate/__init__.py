"""Find where the arm stands and how it holds its racket, from touched points or camera images: `ros2 run tt_bringup locate`."""
