"""What the Mixture of Attractors is compared with: other models of paths over time, in the same skill.

Each is a learner with the alignment, presses and orientations of `policies.trajectory_learner.TrajectoryLearner`; only the
generator of the path differs. Replay, ProMP, DMP and GMR know no frame but the world; TP-GMM and VAR-DMP know all of them.
"""
