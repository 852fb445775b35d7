"""What is learned from demonstrations: learners, and the skills they learn.

This package stands on `lfd_gym` alone. Its only contact with teachers is a file of demonstrations.
"""
