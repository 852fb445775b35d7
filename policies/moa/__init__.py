"""Mixture of Attractors: movements of any shape, relative to several frames, by one convex problem (thesis chapter 4).

`mixture_of_attractors` learns from demonstrations and draws in new scenes, `frames` says what is where, `alignment` brings
demonstrations to one time, `spatial` goes by position instead of time. Below them lie the convex problem (`tracking`,
`setting`), its solvers (`interior_point`, `generic_solver`, `softmax`), the choice among many minimisers (`tie_break`), and the
likelihood form (`one_step`).
"""
