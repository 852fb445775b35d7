"""lfd_gym: a simulated Barrett WAM learns sequential, contact-rich manipulation from a handful of demonstrations."""

from lfd_gym.registry import register

register()
