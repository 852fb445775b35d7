"""Fine-tuning: from a skill and an environment to a skill that has practised.

| method | what is learned |
|---|---|
| `cma`, `es-gradient` | goal offsets of a sequence graph, logits and offsets of a Mixture of Attractors: `skill_parameters` |
| `graph-ppo` | a residual on the log-probabilities of a sequence graph's classifiers: `refined_graph` |
| `residual-sac` | a bounded residual on the actions of any skill: `residual` |

Whatever the method, an eighth of the episodes (at most 100) is kept back: the skill before and the skill after do the same
fresh setups, and the one before is returned unless the one after scores as much.
"""

import time
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

from lfd_gym.errors import InvalidArgumentError
from lfd_gym.evaluation import check_fits
from lfd_gym.registry import environment_id, look_up, make
from lfd_gym.seeds import SEEDS_PER_RUN, check_run
from policies.reinforcement import FINETUNERS
from policies.reinforcement.practice import Practice, practise, scores
from policies.reinforcement.settings import checked_kwargs
from policies.skill import Skill

FEWEST = 16
"""Episodes of a practice."""
EPISODES_PER_CHECK, MOST_CHECKED = 16, 50
"""Episodes for which the last check has one setup, which is done twice; and setups at most."""


def finetune(
    name: str,
    skill: Skill,
    env_id: str,
    episodes: int,
    folder: Path,
    seed: int = 0,
    env_kwargs: Mapping[str, Any] | None = None,
    jobs: int = 1,
    progress: bool = False,
) -> Skill:
    """The skill after about so many episodes of practice; one that was killed goes on from what `folder` keeps.

    Raises UnknownNameError for an unknown method, and InvalidArgumentError for a skill of another environment or control step,
    one that the method cannot practise, arguments that the method decides, fewer than 16 episodes, and a seed out of range.
    """
    method = look_up(FINETUNERS, "method", name)
    env_id, kwargs = environment_id(env_id), checked_kwargs(env_kwargs or {})
    with closing(make(env_id, **kwargs)) as env:
        check_fits(skill, env)
    if episodes < FEWEST:
        raise InvalidArgumentError(f"{episodes} episodes; at least {FEWEST} are needed")
    check_run(seed)
    checked = min(MOST_CHECKED, episodes // EPISODES_PER_CHECK)
    practice = Practice(skill, env_id, kwargs, episodes - 2 * checked, folder, seed, jobs, progress)
    after, facts = method(practice)
    since = time.monotonic()
    first = practice.first_seed + SEEDS_PER_RUN // 2
    check = practise([skill, after], env_id, kwargs, range(first, first + checked), jobs)
    before_score, after_score = scores(check).tolist()
    seconds = sum(episode.seconds for row in check for episode in row)
    facts = {
        "method": name,
        **facts,
        "episodes": facts["episodes"] + 2 * checked,
        "simulated_hours": round(facts["simulated_hours"] + seconds / 3600.0, 4),
        "seconds": round(facts["seconds"] + time.monotonic() - since, 1),
        "check": [before_score, after_score],
        "kept": bool(after_score >= before_score),
    }
    result = after if facts["kept"] else skill
    return result.with_facts(metadata={**result.metadata, "finetuned": facts})
