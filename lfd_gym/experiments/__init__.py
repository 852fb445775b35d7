"""Experiments: each makes its table (and figure) again with one command, `lfd-gym experiment NAME --out DIR`.

An experiment is a function `run(out, quick, jobs) -> str` that writes into a folder and returns its table as Markdown. Finished
rows are kept as files, so that an experiment that was interrupted goes on where it stopped.
"""

EXPERIMENTS: dict[str, str] = {
    "teachers": "lfd_gym.experiments.teachers:run",
    "sequence-graphs": "lfd_gym.experiments.sequence_graphs:run",
    "slips": "lfd_gym.experiments.slips:run",
    "perturbations": "lfd_gym.experiments.perturbations:run",
    "one-demonstration": "lfd_gym.experiments.one_demonstration:run",
    "goal-learning": "lfd_gym.experiments.goal_learning:run",
    "graphs": "lfd_gym.experiments.graphs:run",
    "classifiers": "lfd_gym.experiments.classifiers:run",
    "grasping": "lfd_gym.experiments.grasping:run",
    "decompose-flipping": "lfd_gym.experiments.decomposition:flipping",
    "decompose-stacking": "lfd_gym.experiments.decomposition:stacking",
    "decompose-light-bulb": "lfd_gym.experiments.decomposition:light_bulb",
    "omniglot": "lfd_gym.experiments.omniglot:run",
    "start-equals-end": "lfd_gym.experiments.start_equals_end:run",
    "subsets": "lfd_gym.experiments.subsets:run",
    "toy": "lfd_gym.experiments.toy:run",
    "moa-scaling": "lfd_gym.experiments.moa_scaling:run",
    "writing": "lfd_gym.experiments.writing:run",
    "decomposition-methods": "lfd_gym.experiments.decomposition_methods:run",
    "moa-tasks": "lfd_gym.experiments.moa_tasks:run",
    "finetuning": "lfd_gym.experiments.finetuning:run",
    "comparison": "lfd_gym.experiments.comparison:run",
}
