"""How often the search is right: suites of virtual machines, other methods on the same data, error rates.

`suite` runs them for `vtsdt validate discrepancy`; `trials` has the rates and their page.  Takes from every other room.
"""
