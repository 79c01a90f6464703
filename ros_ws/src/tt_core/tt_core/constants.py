"""The ball, the table, the net and the racket. Frame `table`: origin at the corner at the robot's right hand, playing surface z = 0."""

BALL_RADIUS = 0.02  # m, dissertation Table A.2
BALL_MASS = 2.7e-3  # kg, dissertation Table A.2
AIR_DENSITY = 1.184  # kg/m^3 at 25 C, dissertation Table 4.1
GRAVITY = 9.8  # m/s^2, dissertation Table 4.1

TABLE_LENGTH = 2.74  # m along x, dissertation Table A.1
TABLE_WIDTH = 1.525  # m along y, dissertation Table A.1
FLOOR_Z = -0.76  # m, height of the floor, dissertation Table A.1
TABLE_THICKNESS = 0.025  # m, of a usual competition table
NET_X = 1.37  # m
NET_HEIGHT = 0.1525  # m, ITTF laws 2.2
NET_OVERHANG = 0.1525  # m beyond each side line, ITTF laws 2.2

RACKET_RADIUS = 0.075  # m, half the width of a usual blade (150 mm)

RPM = 2.0 * 3.141592653589793 / 60.0  # rad/s in one revolution a minute
COMMAND_TIMEOUT = 0.1  # s for which the drives of an arm hold a command, where its arm file states no other
