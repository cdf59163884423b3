"""How many taps a material needs in an environment, for an error that is accepted.

``probe`` measures candidates on a few cameras, ``model`` says what that is worth (cost, and how far
another picture's error may lie above), ``plan`` chooses, ``auto`` is the method that runs a plan.
"""
