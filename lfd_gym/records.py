"""The controller's data: constants, command and memory as records, so that its state is saved and restored as bytes."""

import numpy as np

SETTINGS = np.dtype(
    [
        ("dt", "f8"),
        ("alpha", "f8"),
        ("beta", "f8"),
        ("speed_limit", "f8"),
        ("turn_limit", "f8"),
        ("workspace_low", "f8", 3),
        ("workspace_high", "f8", 3),
        ("upper_arm", "f8"),
        ("forearm", "f8"),
        ("bend", "f8", 2),
        ("stiffness", "f8"),
        ("damping", "f8"),
        ("integral", "f8"),
        ("integral_limit", "f8", 2),
        ("lead_limit", "f8", 2),
        ("force_integral", "f8"),
        ("force_damping", "f8"),
        ("filter", "f8"),
        ("rest", "f8", 7),
        ("joint_low", "f8", 7),
        ("joint_high", "f8", 7),
        ("joint_speed", "f8"),
        ("joint_brake", "f8"),
        ("torque_limit", "f8", 7),
        ("joint_damping", "f8", 7),
        ("joint_friction", "f8", 7),
        ("friction_speed", "f8"),
        ("tool_mass", "f8"),
        ("gravity", "f8", 3),
        ("n_hand", "i8"),
        ("hand_speed", "f8", 4),
        ("hand_stiffness", "f8", 4),
        ("hand_stall", "f8", 4),
    ],
    align=True,
)
"""Constants of one environment, in SI units; the first of a pair is linear, the second angular."""

COMMAND = np.dtype(
    [
        ("position", "f8", 3),
        ("quaternion", "f8", 4),
        ("force", "f8", 3),
        ("hand", "f8", 4),
        ("sensor_error", "f8", 6),
    ],
    align=True,
)
"""What one control step is given: the goal's pose in the world, force of the tool on the world [N], hand joint angles [rad];
and by how much the wrist sensor errs, force [N] and torque [N m], world axes."""

MEMORY = np.dtype(
    [
        ("position", "f8", 3),
        ("quaternion", "f8", 4),
        ("velocity", "f8", 6),
        ("tool_velocity", "f8", 6),
        ("integral", "f8", 6),
        ("mode", "f8"),
        ("timer", "f8"),
        ("direction", "f8", 3),
        ("force_integral", "f8"),
        ("pressed", "f8", 3),
        ("wrench_sum", "f8", 6),
        ("ticks", "f8"),
        ("hand", "f8", 4),
        ("guided", "f8"),
        ("guide_position", "f8", 3),
        ("guide_quaternion", "f8", 4),
        ("guide_velocity", "f8", 6),
        ("guide_force", "f8", 3),
        ("guide_torque", "f8", 3),
        ("guide_holds", "f8"),
    ],
    align=True,
)
"""The controller's state: the reference's pose and twist, the measured twist of the tool, integrals, contact mode, filtered
force of the tool on the world, the sum of the wrenches since the last observation, the references of the hand's drives, and
whether an outside hand guides the arm, with its pose, twist and force."""
