"""The words of the templates that depend on the environment: `islandgp new --kind gymnasium`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from islandgp.errors import ConfigError

EPISODES: Final = 20  # random ones, which give the ranges of keys without bounds
MAX_STEPS: Final = 500  # of each


def words(name: str) -> dict[str, str]:
    """The placeholders of the Gymnasium template, from the environment's spaces.

    Raises:
        ConfigError: Gymnasium or the environment is missing, or its spaces are of other types.
    """
    try:
        import gymnasium
    except ModuleNotFoundError:
        raise ConfigError(
            "Expected the package gymnasium, found none; pip install 'islandgp[gymnasium]'."
        ) from None
    try:
        env: Any = gymnasium.make(name)
    except Exception as error:  # Gymnasium and environments raise anything
        reason = " ".join(str(error).split())
        raise ConfigError(f"--environment: expected one of Gymnasium, found {reason}") from error
    space, actions = env.observation_space, env.action_space
    known = (gymnasium.spaces.Box, gymnasium.spaces.Discrete)
    for each in (space, actions):
        if type(each) not in known or len(each.shape) > 1:
            raise ConfigError(
                f"--environment: expected spaces of type Discrete or Box with one dimension, found"
                f" {each}; write the YAML by hand, as docs/domains.md shows."
            )
    ranges, good = _ranges(env)
    keys = [
        f"    key{at}: {{at: {at}, range: [{low:g}, {high:g}], step: {step:g}, meaning: number {at}"
        " of the observation}"
        for at, (low, high, step) in enumerate(ranges)
    ]
    choices = list(_choices(actions))
    target, steps = env.spec.reward_threshold, env.spec.max_episode_steps
    env.close()
    return {
        "ENVIRONMENT": name,
        "TICKS": str(steps or MAX_STEPS),
        "OBSERVATIONS": "\n".join(keys),
        "ACTIONS": "\n".join(f"    Act{i}: {entry}" for i, (entry, _, _) in enumerate(choices)),
        "TARGET": "Gymnasium names no return that solves it"
        if target is None
        else f"Gymnasium's own is {{return: {target:g}}}",
        "GOOD": f"{good:g}",
        "MIDDLE": f"{(ranges[0][0] + ranges[0][1]) // 2:g}",
        "FIRST": f"Act0{choices[0][1]}",
        "LAST": f"Act{len(choices) - 1}{choices[-1][2]}",
    }


def _choices(actions: Any) -> Iterator[tuple[str, str, str]]:
    """The actions: entry of YAML, and arguments of the least and the largest value.

    An action is one of a Discrete space, or sets one number of a Box.
    """
    if hasattr(actions, "n"):
        for value in range(int(actions.start), int(actions.start + actions.n)):
            yield f"{{do: {value}, meaning: action {value} of the environment}}", "", ""
        return
    bounds = zip(actions.low.tolist(), actions.high.tolist(), strict=True)
    for at, (low, high) in enumerate(bounds):
        low, high = max(low, -1e3), min(high, 1e3)
        argument = f"value: {{at: {at}, range: [{low:g}, {high:g}], meaning: its value}}"
        entry = f"{{meaning: sets number {at} of the action, arguments: {{{argument}}}}}"
        yield entry, f"(value: {low:g})", f"(value: {high:g})"


def _ranges(env: Any) -> tuple[list[tuple[float, float, float]], float]:
    """Range and step of each key: the space's own, or where it has none, that of random episodes.

    Returns:
        Least value, largest value, and distance between thresholds, for each number; and a reward
        that about a tenth of the steps of random episodes exceed.
    """
    import numpy as np

    seen, rewards = [], []
    env.action_space.seed(0)
    for seed in range(EPISODES):
        observation, _ = env.reset(seed=seed)
        for _ in range(MAX_STEPS):
            seen.append(np.ravel(np.asarray(observation, dtype=float)))
            observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
            rewards.append(float(reward))
            if terminated or truncated:
                break
    space, values = env.observation_space, np.clip(np.array(seen), -1e6, 1e6)
    if whole := hasattr(space, "n"):
        lows, highs = np.array([space.start]), np.array([space.start + space.n - 1])
    else:
        lows, highs = space.low, space.high
    ranges = []
    for at, (low, high) in enumerate(zip(lows.astype(float), highs.astype(float), strict=True)):
        if max(abs(low), abs(high)) > 1e3:
            low, high = values[:, at].min(), values[:, at].max()
        unit = 10.0 ** np.floor(np.log10(max(high - low, 1e-6)))
        low, high = np.floor(low / unit * 10) * unit / 10, np.ceil(high / unit * 10) * unit / 10
        ranges.append((float(low), float(high), 1.0 if whole else float(unit / 10)))
    good = float(np.quantile(rewards, 0.9))
    if good == max(rewards):
        good = (min(rewards) + good) / 2 if min(rewards) < good else good - 1
    return ranges, good
