"""Reinforcement learning on the RL view: agents, behaviour cloning, and the fine-tuning of skills.

Skills run in numpy; only what trains imports torch, Stable-Baselines3, sb3-contrib and cma (extra `rl`).
"""
