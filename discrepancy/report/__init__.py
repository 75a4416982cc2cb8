"""What is written of a conclusion: diagnosis.json, the HTML page and its figures.

Takes from `discrepancy.conclusion` and what is below it.
"""
