"""The page of the live view: 3D scene, panels and buttons, served by viser. Actions that a user asks for are put into a queue."""

from __future__ import annotations

import html
from collections.abc import Sequence
from functools import partial
from itertools import zip_longest
from queue import SimpleQueue

import cv2
import numpy as np
import viser
from tt_core.arrays import Array
from tt_core.constants import FLOOR_Z, NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import TtError
from tt_core.states import ReturnGoal
from tt_racket.goal import GoalParams
from tt_sim.world.launcher import RATES, SCALES, SHOT_KINDS

from .actions import Action, Enable, Launch, Pause, SetGoal, SetRate, Step, Stop
from .items import Item
from .readings import Readings
from .scene import DrawnScene
from .viser_scene import ViserScene

TITLE = "Table tennis robot"
LEVEL_COLOURS = ("#2e8b57", "#c77f1a", "#c0392b", "#888888")  # colours of the levels of diagnostics: OK, warning, error, stale
LEVEL_NAMES = ("ok", "warning", "error", "stale")
EYE, TARGET = (-1.6, -3.1, 2.3), (0.75, 0.76, 0.0)  # m in `table`, first position of the view's camera, and the point it looks at
FIELD_OF_VIEW = 0.9  # rad, vertical
NARROW = np.array([-0.4, -0.5, 1.3])  # m, shift of both in a narrow window, so that the table is above the panels
SIDE = 232  # pixels, width of an image that is sent; a taller image is squeezed to this height
STYLE = "font-size:0.8em;line-height:1.35;width:100%;border-collapse:collapse"


class Page:
    """The page of the live view.

    All its methods are called by one thread. Pressed buttons are handled by threads of viser, which put actions into the queue.

    Attributes:
        actions: Queue of the actions that users have asked for.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        """Make the 3D scene, the panels and the buttons on a viser server."""
        self.actions: SimpleQueue[Action] = SimpleQueue()
        self._server, self._scene = server, ViserScene(server.scene)
        server.gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        server.gui.set_panel_label(TITLE)
        server.initial_camera.position, server.initial_camera.look_at = np.array(EYE), np.array(TARGET)
        server.initial_camera.fov = FIELD_OF_VIEW
        server.on_client_connect(step_back)
        server.scene.world_axes.visible = False
        server.scene.add_grid("/floor", width=8.0, height=6.0, cell_size=0.5, position=(1.0, 0.76, FLOOR_Z))
        self._shown = server.gui.add_html("")
        self._add_ball(server.gui)
        self._add_goal(server)
        self._add_arm_and_time(server.gui)
        self._images: tuple[np.ndarray, ...] = ()
        panel = server.gui.add_panel()
        with panel.add_tab("State of the robot"):
            self._cameras = server.gui.add_image(side_by_side(()), label="Left and right camera", format="jpeg")
            with server.gui.add_folder("Latency since the last frame, ms"):
                self._latency = server.gui.add_html("")
            with server.gui.add_folder("Joint speeds and their limits"):
                self._speeds = server.gui.add_html("")
            with server.gui.add_folder("Diagnostics"):
                self._health = server.gui.add_html("")
        panel.dock_left()
        panel.set_width(340)
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(300)

    def _add_ball(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Ball"):
            kind = gui.add_dropdown("Kind", SHOT_KINDS)
            scale = gui.add_slider("Scale", *SCALES, 1, 3)
            launch = gui.add_button("Launch a ball")
            rate = gui.add_slider("Balls a minute", *RATES, 1.0, 30.0)
            repeat, cease = gui.add_button("Launch at this rate"), gui.add_button("Cease launching")
        launch.on_click(lambda _: self.actions.put(Launch(f"{kind.value} {int(scale.value)}")))
        repeat.on_click(lambda _: self.actions.put(SetRate(f"{kind.value} {int(scale.value)}", float(rate.value))))
        cease.on_click(lambda _: self.actions.put(SetRate(f"{kind.value} {int(scale.value)}", 0.0)))

    def _add_goal(self, server: viser.ViserServer) -> None:
        default = GoalParams()
        with server.gui.add_folder("Return: click the far half"):
            time = server.gui.add_number("Flight time, s", default.flight_time, min=0.1, max=2.0, step=0.01)
            spin_y = server.gui.add_number("Spin y, rad/s", default.top_spin_y, min=-2000.0, max=2000.0, step=1.0)
            spin_z = server.gui.add_number("Spin z, rad/s", 0.0, min=-2000.0, max=2000.0, step=1.0)

        @server.scene.on_click()
        def _(event: viser.SceneClickEvent) -> None:
            place = clicked_place(np.array(event.ray_origin), np.array(event.ray_direction))
            if place is None:
                return
            try:
                goal = ReturnGoal(place, float(time.value), float(spin_y.value), float(spin_z.value))
            except TtError as error:
                event.client.add_notification("Refused", str(error), color="red")
                return
            self.actions.put(SetGoal(goal))

    def _add_arm_and_time(self, gui: viser.GuiApi) -> None:
        with gui.add_folder("Arm"):
            stop, enable = gui.add_button("Stop the arm", color="red"), gui.add_button("Enable the arm", color="green")
        with gui.add_folder("Simulated time"):
            pause, go_on, step = gui.add_button("Pause"), gui.add_button("Go on"), gui.add_button("Step")
        buttons = ((stop, Stop()), (enable, Enable()), (pause, Pause(True)), (go_on, Pause(False)), (step, Step()))
        for button, action in buttons:
            button.on_click(partial(self._ask, action))

    def _ask(self, action: Action, _: object) -> None:
        """Put an action into the queue when its button is pressed."""
        self.actions.put(action)

    def draw(self, items: Sequence[Item]) -> None:
        """Show the items in the 3D scene, and no others."""
        with self._server.atomic():
            self._scene.draw(items)

    def show(self, scene: DrawnScene, readings: Readings, now: float) -> None:
        """Update the panels: images, latencies, joint speeds, diagnostics and the message to the user.

        Args:
            scene: The scene, which has the joint speeds.
            readings: All other data of the panels.
            now: Present time, s.
        """
        missing = [f"mesh not found: {place}" for place in sorted(self._scene.missing)]
        self._shown.content = f"<div style='padding:0 1em;font-size:0.85em'>{html.escape(' '.join([readings.shown, *missing]))}</div>"
        self._latency.content = latency_table(readings)
        self._speeds.content = speed_bars(scene)
        self._health.content = health_table(readings, now)
        images = tuple(readings.images[side].image for side in sorted(readings.images))
        if any(image is not before for image, before in zip_longest(images, self._images)):
            self._images = images
            self._cameras.image = side_by_side(images)


def step_back(client: viser.ClientHandle) -> None:
    """Move the view's camera back if a browser's window is narrow, as on a phone, so that the whole table is visible above the panels."""
    if client.camera.aspect < 1.0:
        client.camera.position = np.array(TARGET) + 1.9 * (np.array(EYE) - TARGET) - NARROW
        client.camera.look_at = np.array(TARGET) - NARROW


def clicked_place(origin: Array, direction: Array) -> Array | None:
    """Return the point at which the ray of a mouse click meets the opponent's half of the table.

    Args:
        origin: (3,) m, start of the ray in the frame `table`.
        direction: (3,) direction of the ray, of any length.

    Returns:
        x and y of the point, (2,) m; None if the ray does not meet this half from above.
    """
    if direction[2] >= -1e-9 or origin[2] <= 0.0:  # it does not come from above
        return None
    place: Array = (origin - direction * origin[2] / direction[2])[:2]
    return place if NET_X < place[0] <= TABLE_LENGTH and 0.0 <= place[1] <= TABLE_WIDTH else None


def side_by_side(images: Sequence[np.ndarray]) -> np.ndarray:
    """Return up to two images beside each other as one RGB image.

    Args:
        images: (h, w) each, uint8 or uint16.

    Returns:
        (SIDE, 2 SIDE, 3) uint8. Each image is SIDE pixels wide, and its grey levels are scaled so that its brightest pixel is white.
    """
    shown = np.zeros((SIDE, 2 * SIDE, 3), np.uint8)
    for i, image in enumerate(images[:2]):
        height, width = image.shape
        rows = min(SIDE, max(1, round(height * SIDE / width)))
        small = cv2.resize(image.astype(np.float32), (SIDE, rows), interpolation=cv2.INTER_AREA)
        shown[:rows, i * SIDE : (i + 1) * SIDE] = (255.0 / max(1.0, float(small.max())) * small)[:, :, None].astype(np.uint8)
    return shown


def latency_table(readings: Readings) -> str:
    """Return a table of the newest and the median latency of each stage as HTML."""
    rows = "".join(
        f"<tr><td>{html.escape(stage)}</td><td align='right'>{last:.1f}</td><td align='right'>{median:.1f}</td></tr>"
        for stage, last, median in readings.median_latencies()
    )
    return f"<table style='{STYLE}'><tr><td></td><td align='right'>newest</td><td align='right'>median</td></tr>{rows}</table>"


def speed_bars(scene: DrawnScene) -> str:
    """Return a table with a bar for each joint, its speed relative to its limit, as HTML."""
    rows = []
    for name, limit in scene.robot.speed_limits.items():
        speed = abs(scene.joints.speeds.get(name, 0.0))
        share = min(1.0, speed / limit) if limit > 0.0 else 0.0
        colour = LEVEL_COLOURS[0] if share < 0.8 else LEVEL_COLOURS[1] if share < 1.0 else LEVEL_COLOURS[2]
        bar = f"<div style='background:{colour};height:0.8em;width:{100.0 * share:.1f}%'></div>"
        value = f"{speed:.2f} / {limit:.2f}"
        rows.append(
            f"<tr><td>{html.escape(name[:12])}</td><td style='width:55%;background:#8883'>{bar}</td><td align='right'>{value}</td></tr>"
        )
    return f"<table style='{STYLE}'>{''.join(rows)}</table>"


def health_table(readings: Readings, now: float) -> str:
    """Return a table of the diagnostics at the time `now` (s) as HTML, the worst first."""
    rows = []
    for status in readings.health_at(now):
        level = min(status.level, 3)
        label = f"<span style='color:{LEVEL_COLOURS[level]}'>{LEVEL_NAMES[level]}</span>"
        rows.append(
            f"<tr style='vertical-align:top'><td>{html.escape(status.name[:40])}</td><td>{label}</td>"
            f"<td>{html.escape(status.message[:120])}</td></tr>"
        )
    return f"<table style='{STYLE}'>{''.join(rows)}</table>"
