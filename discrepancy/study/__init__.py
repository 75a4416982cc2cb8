"""`Study`: from a study file to a conclusion; its history in a file; the commands ``diagnose`` and ``compare``.

Takes from every other room but the rigs and the validation.
"""
