"""Report on a recorded run, ball by ball: as an HTML page, and as text.

Run as `ros2 run tt_bringup report BAG`. `run_record` splits the recording into balls, `ball_images` measures its images anew, `figures` and
`rally_scene` make the figures and the 3D scene, `words` makes the text, and `run_page` writes the page.
"""

from .main import main
from .run_page import write_report

__all__ = ["main", "write_report"]
