"""Reinforcement learning on the RL view: agents, behaviour cloning, and the fine-tuning of skills.

Skills run in numpy; only what trains imports torch, Stable-Baselines3, sb3-contrib and cma (extra `rl`).
"""

FINETUNERS: dict[str, str] = {
    "cma": "policies.reinforcement.parameter_search:by_cma",
    "es-gradient": "policies.reinforcement.parameter_search:by_gradient",
    "graph-ppo": "policies.reinforcement.learned_residuals:refine_graph",
    "residual-sac": "policies.reinforcement.learned_residuals:learn_residual",
}
"""Name of the method -> function from a `Practice` to the skill and its facts."""
