"""Machines of plain equations, on which the search is judged; each has a baseline model and effects to hide.

`fleet` lists them, `case` draws and writes one case, `grading` scales what is hidden, `judge` scores an answer, `suite`
runs many.  The machines take nothing from `multibody`; only the texts of their baseline models do.
"""
