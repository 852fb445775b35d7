"""What the Mixture of Attractors is compared with: other models of paths over time, in the same skill.

Each is a learner with the alignment, presses and orientations of `policies.moa_learner.TrajectoryLearner`; only the generator
of the path differs. Replay, ProMP, DMP and GMR know no frame but the world; TP-GMM and VAR-DMP know all of them.
"""

BASELINES: dict[str, str] = {
    "tp-gmm": "policies.trajectory_baselines.gaussian_mixture:TPGMMLearner",
    "var-dmp": "policies.trajectory_baselines.dynamic_movement_primitives:VarDMPLearner",
    "gmr": "policies.trajectory_baselines.gaussian_mixture:GMRLearner",
    "promp": "policies.trajectory_baselines.promp:ProMPLearner",
    "dmp": "policies.trajectory_baselines.dynamic_movement_primitives:DMPLearner",
    "replay": "policies.trajectory_baselines.replay:ReplayLearner",
}
"""Name of the method -> its learner."""
