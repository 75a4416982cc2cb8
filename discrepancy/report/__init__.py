"""What is written: conclusion, JSON, HTML, figures.

Takes from `discrepancy.questions` and what is below it.
"""
