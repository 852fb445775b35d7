"""One file per task, on the base of `manipulation_env`."""
