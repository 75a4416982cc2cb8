"""The workbench: a local page in the browser over one `Study`; what is clicked is a step that `history.json` keeps.

`Session` holds the study and the work in hand, `server` gives it to the browser, `command` is ``vtsdt open``.  Takes
from every other room but the rigs and the validation.
"""
