"""Play a hundred balls of the catapult without ROS and without images, and count what comes back."""

from collections import Counter

import numpy as np
from tt_eval.episode import landing_error, play
from tt_eval.scenario import load

scenario = load("liu", images=False)
episodes = [play(scenario, seed) for seed in range(100)]
misses = Counter(str(episode.miss) for episode in episodes if episode.miss)
errors = [1e3 * error for episode in episodes if (error := landing_error(episode)) is not None]
print(f"returned        {len(episodes) - misses.total()} of {len(episodes)}")
print(f"missed          {', '.join(f'{name}: {count}' for name, count in misses.items()) or 'none'}")
print(f"landing error   {np.median(errors):.0f} mm median, {np.percentile(errors, 95):.0f} mm in 95 %")
