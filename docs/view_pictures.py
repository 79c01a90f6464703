"""Take the pictures of the live view for the README: python docs/view_pictures.py FOLDER. Needs the program chromium.

A ball is launched by the button of the page, and simulated time is paused just before the strike.
"""

import argparse
import sys
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_bringup.demo import free_domain, free_port, launched_nodes
from tt_core.ros.convert import seconds, strokes_from_message
from tt_core.ros.qos import LATEST, RELIABLE

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from browser import opened

SIZES = ((1400, 900), (390, 844))  # pixels: of a desk, and of a telephone
BEFORE = 0.03  # s from the pause to the strike
SETTLED = 3000  # ms for the page to draw what it has received


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    free_domain()
    port = free_port()
    arguments = ["use_sim_time:=true", "rtf:=0.2", "view:=true", f"view_port:={port}"]
    with (folder / "log.txt").open("w") as log, launched_nodes(arguments, log):
        rclpy.init()
        node, executor = rclpy.create_node("pictures"), SingleThreadedExecutor()
        executor.add_node(node)
        clock, strikes = [0.0], []
        node.create_subscription(Clock, "/clock", lambda m: clock.append(seconds(m.clock)), LATEST)
        node.create_subscription(
            MultiDOFJointTrajectory, "/racket/strokes", lambda m: strikes.append(strokes_from_message(m)[0].time), RELIABLE
        )
        pause = node.create_client(SetBool, "/sim/pause")

        def wait(condition) -> None:
            while not condition():
                executor.spin_once(timeout_sec=0.01)

        wait(lambda: {"view", "arm", "sim", "racket"} <= set(node.get_node_names()) and pause.service_is_ready())
        wait(lambda: node.count_subscribers("/racket/strokes") == 4 and len(clock) > 100)
        for i, (width, height) in enumerate(SIZES):
            with opened(f"http://127.0.0.1:{port}/", width, height) as (page, _):
                if i == 0:
                    page.get_by_role("button", name="Launch a ball").click()
                    wait(lambda: strikes and clock[-1] >= strikes[-1] - BEFORE)
                    future = pause.call_async(SetBool.Request(data=True))
                    wait(future.done)
                page.get_by_role("button", name="Close").or_(page.locator("button.mantine-Notification-closeButton")).first.click()
                page.wait_for_timeout(SETTLED)
                page.screenshot(path=folder / f"view_{width}.jpg", type="jpeg", quality=80)
        rclpy.try_shutdown()
    (folder / "log.txt").unlink()


if __name__ == "__main__":
    main()
