"""The conclusion of a study as a plain value: verdict, sentences, what could still hide, what to measure next.

Takes from `discrepancy.questions` and what is below it.
"""
