"""Report what became of a recorded run: as a page, and as text.

Run as `ros2 run tt_bringup report BAG`. `run_record` splits the recording into balls, `ball_images` measures its images anew, `figures` and
`rally_scene` draw, `words` has the sentences and the text, `run_page` puts the page together.
"""

from .main import main
from .run_page import write_report

__all__ = ["main", "write_report"]
