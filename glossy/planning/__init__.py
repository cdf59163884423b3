"""How many taps a material needs in an environment, for an error that is accepted.

``views`` says where candidates are measured: on a picture's own points, or on narrow views from
everywhere; ``probe`` measures them there against the ground truth, ``model`` lists them with their
costs, ``plan`` chooses, ``auto`` is the method that runs a plan.
"""
